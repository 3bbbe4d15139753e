# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Lag of the samples behind the photo-eyes, from the rise of the load.

Between t1 and t2 a product rides onto the belt. A linear system of unity gain (platform, amplifier,
low-pass) delays the rise by its delay at frequency 0 and does not change the area under it
otherwise. A clock offset does the same. Let the signal y be z on the empty belt and z + M at the
level, s the share of the product on the belt according to the eyes, and l the lag: [own derivation]

.. math:: l = \frac{1}{M} \int a(t) \, \big(z + M s(t - l) - y(t)\big) \, dt + l

where a is 1 during the rise and falls smoothly to 0 before and after it, so that ringing averages
out. z and M are Hann-weighted means of the empty belt and of the level. Nothing is assumed about
the platform.

A load that rises unevenly, bent as u - k u (1 - u) over the share u of the time, also has a lag,
although it is complete at t2. This part of the lag is k (t2 - t1) / 6. The residual of the signal
at the lag has no area, so for small k this part is the integral of 30 u (1 - u) times the residual.
"""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import WeighWindow, seconds

PLATFORM_LAG = 5e-4  # s, 2 xi / omega of the default platform
_TAPER = 0.05  # s, of a; at most half of the level
_EMPTY = 0.3  # s, longest empty belt in the mean z
_SHORTEST_EMPTY = 0.06  # s; less does not show the vibration of the belt
_FEWEST = 8  # samples of empty belt, and of level
_ROUNDS = 10
_CLOSE = 1e-5  # s
# Share of the level's vibration that counts, because most of it is ringing, which averages out.
_LEVEL_SHARE = 0.25
# s, standard deviations of lag and bend due to impact and bouncing as a product rides on.
_SYSTEMATIC = 1e-4
_SYSTEMATIC_BEND = 8e-4


@dataclass(frozen=True, slots=True)
class RiseLag:
    """Delay of the rise of the load relative to the photo-eyes in s; NaN if unknown.

    `bend` is the part of the lag that is due to an uneven rise of the load.
    """

    lag: float = math.nan
    std_dev: float = math.nan
    bend: float = math.nan
    bend_std_dev: float = math.nan

    @property
    def is_known(self) -> bool:
        """Whether the lag is known."""
        return not math.isnan(self.lag)


def rise_lag(
    force: NDArray[np.float64], time: NDArray[np.float64], rise_time: float, transit: float
) -> RiseLag:
    """Return the lag of a rise and its standard deviation.

    Parameters
    ----------
    force : ndarray, (n,) float64
        Signal of the empty belt before an item and of the item up to t3, in any unit in which the
        item is positive; the zero need not be removed.
    time : ndarray, (n,) float64
        Time of the samples since t1, at equal intervals, s.
    rise_time, transit : float
        t2 - t1 and t3 - t1, s.

    Returns
    -------
    RiseLag
        The standard deviations apply the same functionals to the empty belt before the item and, in
        part, to the level after it.

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
    # Empty belt and level by signal and eyes; by the signal alone if the two are too far apart.
    begin, end = (int(time.searchsorted(at)) for at in (min(lag, 0.0), rise_time + max(lag, 0.0)))
    stop = int(time.searchsorted(transit + min(lag, 0.0)))
    if min(begin, stop - end) < _FEWEST:
        begin, end = (int(time.searchsorted(at)) for at in (lag, rise_time + lag))
    share = np.clip((time - lag) / rise_time, 0.0, 1.0)
    bend = 30 * (time[1] - time[0]) * share * (1 - share)
    bent = zero * np.add.reduce(bend) + level * (bend @ share) - bend
    std_devs = []
    for weights, systematic in ((late, _SYSTEMATIC), (bent, _SYSTEMATIC_BEND)):
        used = np.flatnonzero(weights)
        weights = weights[used[0] : used[-1] + 1]
        ringing = _LEVEL_SHARE * _noise(force[end:stop], weights)
        noise = math.hypot(_noise(force[:begin], weights), ringing)
        std_devs.append(math.hypot(noise / mass, systematic))
    return RiseLag(lag, std_devs[0], float(bent @ force) / mass, std_devs[1])


def lag_of(window: WeighWindow) -> RiseLag:
    """Return the lag of the rise in a window that was cut by the eyes."""
    t1, t2, t3 = window.t1, window.t2, window.t3
    if t1 is None or t2 is None or t3 is None:
        return RiseLag()
    begin, end = window.empty_begin, window.window_end
    time = seconds(window.stamp - t1) + np.arange(begin, end) / window.sample_rate
    if len(time) < _FEWEST or time[0] >= 0:
        return RiseLag()
    return rise_lag(window.force_between(begin, end), time, seconds(t2 - t1), seconds(t3 - t1))


def _weights(
    time: NDArray[np.float64], rise_time: float, transit: float, lag: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the weights of the samples in z, in M and in M times the error of the lag, (n,) each.

    Returns None if the empty belt or the level is too short.
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
    share = np.clip(since / rise_time, 0.0, 1.0)
    level -= zero
    return zero, level, zero * np.add.reduce(area) + level * (area @ share) - area


def _bell(time: NDArray[np.float64], begin: float, end: float) -> NDArray[np.float64]:
    """Return a Hann window from `begin` to `end` at the times of samples."""
    return np.sin(math.pi * np.clip((time - begin) / (end - begin), 0.0, 1.0)) ** 2


def _noise(force: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return the root mean square of a weighted sum of noise such as `force`, (n,).

    The noise is tapered, so that it may be shorter than the weights (m,).
    """
    noise = force - np.add.reduce(force) / len(force)
    taper = np.sin((np.arange(len(force)) + 0.5) * (math.pi / len(force)))
    seen = np.correlate(noise * taper, weights, 'full')
    return math.sqrt(float(seen @ seen) / float(taper @ taper))
