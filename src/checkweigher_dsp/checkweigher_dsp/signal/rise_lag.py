# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Lag of the signal behind the edges of the photo-eyes, measured on the rise of the load.

Between t1 and t2 a product moves onto the belt. A linear system of unity gain, such as the platform
or an amplifier, delays the rise of the load by its group delay at frequency 0. Apart from the
delay, a linear system of unity gain does not change the area under the signal. An offset between
the clocks of the signal and of the photo-eyes has the same effect as a delay. Let y be the signal,
which is z on the empty belt and z + M under the full load. Let s be the fraction of the product on
the belt according to the photo-eyes. Then the lag l satisfies this equation (own derivation):

.. math:: l = \frac{1}{M} \int a(t) \, \big(z + M s(t - l) - y(t)\big) \, dt + l

where a is 1 during the rise and falls smoothly to 0 before and after it, so that ringing averages
out. z and z + M are Hann-weighted means of the signal of the empty belt and of the signal under the
full load. The platform is assumed only to be linear, with unity gain.

An uneven rise also causes a lag, although the load is complete at t2. Let the load after the
fraction u of the rise time be M (u - k u (1 - u)). Then the lag is larger than for an even rise by
k (t2 - t1) / 6, which is called the bend. The lag l makes the area of the residual
z + M s(t - l) - y(t) zero. So for small k, the bend is the integral of 30 u (1 - u) times the
residual, divided by M.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from checkweigher_core.records import WeighWindow, seconds
from checkweigher_dsp.signal import Array

PLATFORM_LAG = 5e-4  # lag 2 xi / omega of the default platform in s
_TAPER = 0.05  # longest taper of the weight a in s
_EMPTY = 0.3  # longest duration in s of the empty-belt signal from which z is computed
_SHORTEST_EMPTY = 0.06  # shortest duration in s of an empty-belt signal that shows the vibration
_FEWEST = 8  # minimum number of samples for z, and for z + M
_ROUNDS = 10  # maximum number of iterations for the lag.
# Change of the lag in s below which the iteration ends.
_CLOSE = 1e-5
# Fraction of the vibration under the full load that counts as noise. Most of the vibration is
# ringing, which averages out.
_LEVEL_SHARE = 0.25
# Standard deviations in s of the lag and of the bend due to the impact of a product.
_SYSTEMATIC = 1e-4
_SYSTEMATIC_BEND = 8e-4


class Bend(NamedTuple):
    """Part of the lag that is caused by an uneven rise, and its standard deviation, in s."""

    lag: float = math.nan
    std_dev: float = math.nan


@dataclass(frozen=True, eq=False)
class RiseLag:
    """Lag of the load behind the edges of the photo-eyes, and its standard deviation, in s.

    The lag is positive if the load rises later than the edges indicate. All values are NaN if the
    lag is unknown. `find_bend` computes the bend. This takes a quarter of the time of the lag, and
    few items need it.
    """

    lag: float = math.nan
    std_dev: float = math.nan
    find_bend: Callable[[], Bend] = Bend

    @property
    def is_known(self) -> bool:
        """Whether the lag is known."""
        return not math.isnan(self.lag)

    @cached_property
    def bend(self) -> Bend:
        """Part of the lag that is caused by an uneven rise of the load."""
        return self.find_bend()


def rise_lag(force: Array, time: Array, rise_time: float, transit: float) -> RiseLag:
    """Return the lag of the rise of the load, with its bend and their standard deviations.

    Parameters
    ----------
    force : ndarray, (n,) float64
        Signal from the empty belt before an item up to t3. The unit is arbitrary, but a load must
        be positive. The zero need not be removed.
    time : ndarray, (n,) float64
        Times of the samples since t1 in s, at equal intervals.
    rise_time, transit : float
        Times t2 - t1 and t3 - t1 in s.

    Returns
    -------
    RiseLag
        Lag and bend. Their standard deviations are computed from the noise of the empty belt, a
        part of the noise under the full load, and the effect of the impact of a product. All values
        are NaN if the signal of the empty belt or of the full load is too short, the load is not
        positive, or the iteration for the lag does not converge.

    Examples
    --------
    >>> time = np.arange(-0.3, 0.2, 0.001)
    >>> force = 5.0 + 0.2 * np.clip((time - 0.003) / 0.1, 0.0, 1.0)
    >>> print(round(rise_lag(force, time, rise_time=0.1, transit=0.2).lag, 6))
    0.003
    """
    lag, rise_time = 0.0, max(rise_time, float(time[1] - time[0]))
    for _ in range(_ROUNDS):
        found = _weights(time, rise_time, transit, lag)
        if found is None:
            return RiseLag()
        zero, level, late = found
        mass = float(level @ force)
        if not mass > 0:
            return RiseLag()
        change = float(late @ force) / mass
        if abs(change) < _CLOSE:
            break
        lag += change
    else:
        return RiseLag()
    # Compute the noise where both the signal and the eyes show an empty belt or the full load. If
    # too few samples remain, use only the signal.
    begin, end = (int(time.searchsorted(at)) for at in (min(lag, 0.0), rise_time + max(lag, 0.0)))
    stop = int(time.searchsorted(transit + min(lag, 0.0)))
    if min(begin, stop - end) < _FEWEST:
        begin, end = (int(time.searchsorted(at)) for at in (lag, rise_time + lag))
    empty, ringing = _noise(force[:begin]), _noise(force[end:stop])

    def std_dev(weights: Array, systematic: float) -> float:
        used = np.flatnonzero(weights)
        weights = weights[used[0] : used[-1] + 1]
        noise = math.hypot(_rms(empty, weights), _LEVEL_SHARE * _rms(ringing, weights))
        return math.hypot(noise / mass, systematic)

    def find_bend() -> Bend:
        share = _limited((time - lag) / rise_time)
        bend = 30 * (time[1] - time[0]) * share * (1 - share)
        bent = zero * np.add.reduce(bend) + level * (bend @ share) - bend
        return Bend(float(bent @ force) / mass, std_dev(bent, _SYSTEMATIC_BEND))

    return RiseLag(lag, std_dev(late, _SYSTEMATIC), find_bend)


def lag_of(window: WeighWindow) -> RiseLag:
    """Return the lag of the rise of the load in a weigh window.

    The segmenter has already subtracted the shift of the window from its `stamp`, so the result is
    the remaining lag. All values are NaN if t1, t2 or t3 is unknown, if there are no samples of the
    empty belt before t1 or fewer than eight samples, or if `rise_lag` cannot determine the lag.
    """
    t1, t2, t3 = window.t1, window.t2, window.t3
    if t1 is None or t2 is None or t3 is None:
        return RiseLag()
    begin, end = window.empty_begin, window.window_end
    time = seconds(window.stamp - t1) + np.arange(begin, end) / window.sample_rate
    if len(time) < _FEWEST or time[0] >= 0:
        return RiseLag()
    return rise_lag(window.force_between(begin, end), time, seconds(t2 - t1), seconds(t3 - t1))


def _weights(
    time: Array, rise_time: float, transit: float, lag: float
) -> tuple[Array, Array, Array] | None:
    """Return the weights of the samples for z, for M, and for M times the correction of `lag`.

    Each value is the sum of the samples multiplied by the returned weights, (n,). Returns None if
    there are too few samples of the empty belt or of the full load.
    """
    begin, stop = max(float(time[0]), lag - _EMPTY), transit + min(lag, 0.0)
    zero, level = _bell(time, begin, lag), _bell(time, rise_time + lag, stop)
    interval = float(time[1] - time[0])
    fewest = _FEWEST * interval
    if lag - begin < max(fewest, _SHORTEST_EMPTY) or stop - rise_time - lag < fewest:
        return None
    zero /= np.add.reduce(zero)
    level /= np.add.reduce(level)
    since = time - lag
    taper = min(_TAPER, (stop - rise_time - lag) / 2)
    outside = np.maximum(np.maximum(-since, since - rise_time), 0.0)
    area = interval * np.cos(np.minimum(outside / taper, 1.0) * (math.pi / 2)) ** 2
    share = _limited(since / rise_time)
    level -= zero
    return zero, level, zero * np.add.reduce(area) + level * (area @ share) - area


def _bell(time: Array, begin: float, end: float) -> Array:
    """Return the values of a Hann window from `begin` to `end` at the given times; 0 outside."""
    return np.sin(math.pi * _limited((time - begin) / (end - begin))) ** 2


def _limited(values: Array) -> Array:
    """Return the values limited to the range from 0 to 1, in half the time of `np.clip`."""
    return np.minimum(np.maximum(values, 0.0), 1.0)


def _noise(force: Array) -> tuple[Array, float]:
    """Return the noise of `force`, (n,), multiplied by a taper, and the power of the taper.

    The noise is the difference from the mean. Because of the taper, the noise may have fewer
    samples than the weights that `_rms` applies to it.
    """
    noise = force - np.add.reduce(force) / len(force)
    taper = np.sin((np.arange(len(force)) + 0.5) * (math.pi / len(force)))
    return noise * taper, float(taper @ taper)


def _rms(noise: tuple[Array, float], weights: Array) -> float:
    """Return the root mean square of the weighted sum of m samples of noise, with `weights`, (m,).

    The root mean square is taken over all positions of the weights in the noise. `noise` is a
    result of `_noise`.
    """
    tapered, power = noise
    seen = np.correlate(tapered, weights, 'full')
    return math.sqrt(float(seen @ seen) / power)
