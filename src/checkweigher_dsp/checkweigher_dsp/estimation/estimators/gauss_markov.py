# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Gauss-Markov estimator: the minimum-variance unbiased estimate by a model of the machine.

The signal of a pass is a known shape times the mass, plus other motion of the belt:

.. math:: y(t) = M s(t; M, v) + z + \sum_i c_i o_i(t) + n(t)

s is the response of the platform to the entering load at the belt speed v, divided by the mass M. z
is an error of the zero, and n is noise with the covariance C. o_i are free oscillations of the
platform with unknown amplitudes c_i, caused by the previous product and by the impact at entry. If
C is known, the estimate by generalised least squares has the smallest variance of all unbiased
linear estimates of the mass. The signal before t1, where s is 0, is also used, because it shows z
and the oscillations. Because C relates the noise before t1 to the noise after t1, the signal before
t1 also shows a part of the vibration in the window (own derivation, see docs/method.md).

The parameters of the platform are learned from passes of known mass. C is learned as an
autoregression of the empty belt and of the residuals of the passes.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
import math
from typing import ClassVar

import numpy as np

from checkweigher_core.parameters import ParameterError, parameter
from checkweigher_core.records import WeighWindow, seconds
from checkweigher_dsp.denoising.window_batch import rise_time, transit
from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    LoadEstimate,
    PlotStyle,
    raw_samples,
)
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.platform_response import Crossing, Platform, responses
from checkweigher_dsp.signal.prewhitening import Prewhitener, pooled_reflections

_LEAST_CHANGE = 1e-9  # relative change of the mass at which the iteration ends
_MAX_ITERATIONS = 8
_FREE = 1.0  # prior standard deviation of an unknown oscillation in kg.
# Largest relative deviation of the sample rate of a window from the sample rate of the noise model.
_RATE_TOLERANCE = 1e-3
# Noise models are computed for belt speeds that are multiples of this step in m/s, so that they can
# be cached. Within a step, a spectral line moves by less than its width.
_SPEED_STEP = 1e-3
_UNTRAINED_ORDER = 40  # largest order of the autoregression without training
_LEAST_NOISE = 1e-9  # standard deviation in kg that is used for a signal without noise

_position = partial(parameter, unit='m', minimum=-1, maximum=1)


@dataclass(frozen=True)
class GaussMarkovParameters(EstimatorParameters):
    """Parameters of the Gauss-Markov estimator: the model of the machine that `tune` learns.

    Raises `ParameterError` as `EstimatorParameters` does, and if a reflection coefficient is not
    between -1 and 1.
    """

    node: ClassVar[str] = 'identifier.gauss_markov'

    sample_rate: float = parameter(
        0.0,
        'sample rate of the noise model; 0: not trained, so the noise of the empty belt before '
        'each item is used',
        unit='Hz',
        minimum=0,
        maximum=1e6,
    )
    natural_frequency: float = parameter(
        40.0, 'natural frequency of the empty platform', unit='Hz', minimum=0.1, maximum=1e4
    )
    damping_ratio: float = parameter(
        0.05, 'damping ratio of the empty platform', minimum=0, maximum=0.99
    )
    moving_mass: float = parameter(
        2.5, 'moving mass of the empty platform', unit='kg', minimum=1e-3, maximum=1e4
    )
    entry_begin: float = _position(
        0.0, 'distance that the product has moved since t1 when the load begins to rise'
    )
    entry_end: float = _position(
        0.0, 'distance that the product has moved since t2 when the load is complete'
    )
    impact: tuple[float, ...] = parameter(
        (0.0,),
        'standard deviation of the oscillation after the impact at entry, in kg per kg of mass and '
        'per m/s of belt speed',
        unit='s/m',
        minimum=0,
        maximum=100,
    )
    lead_time: float = parameter(
        0.4, 'longest part of the signal before t1 that is used', unit='s', minimum=0, maximum=60
    )
    max_misfit: float = parameter(
        4.0,
        'largest rms residual of the signal from the model, as a multiple of the noise; above it, '
        'the item gets no mass',
        minimum=1,
        maximum=1e9,
    )
    order: int = parameter(1, 'order of the autoregression', minimum=1, maximum=1000)
    reflection: tuple[float, ...] = parameter(
        (0.0,),
        'reflection coefficients of the autoregression: `order` values for each speed',
        minimum=-1,
        maximum=1,
    )
    noise: tuple[float, ...] = parameter(
        (1e-3,),
        'standard deviation of the innovation of the autoregression',
        unit='kg',
        minimum=0,
        maximum=1e3,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(abs(value) >= 1 for value in self.reflection):
            raise ParameterError(f'{self.node}.reflection: must lie between -1 and 1')

    def fits(self, name: str, count: int) -> bool:
        """Return whether the list `name` may have `count` values."""
        return count == len(self.speeds) * (self.order if name == 'reflection' else 1)

    @property
    def platform(self) -> Platform:
        """Platform without load."""
        return Platform(self.natural_frequency, self.damping_ratio, self.moving_mass)


@dataclass(frozen=True, slots=True)
class PassSignal:
    """Signal of a pass, including the empty belt before it. Times are in s since t1."""

    time: Array  # times of the samples, (n,)
    signal: Array  # signal in kg relative to the zero, (n,)
    crossing: Crossing  # times of the rise and the fall of the load


def pass_signal(window: WeighWindow, parameters: GaussMarkovParameters) -> PassSignal:
    """Return the used part of the signal of a window.

    The used part begins after the previous item has left, and at most ``lead_time`` before t1. If
    the load begins to rise before t1, the ``lead_time`` is counted from this earlier time. The used
    part ends with the last sample, which may be after t3. The times at which the load rises and
    falls are computed from t1, t2, t3, ``entry_begin`` and ``entry_end``.
    """
    begin_at = parameters.entry_begin / window.belt_speed
    end_at = parameters.entry_end / window.belt_speed + rise_time(window)
    # The load falls one transit time, t3 - t1, after it rises.
    leave = transit(window)
    first_at = seconds(window.stamp - (window.t1 or 0))
    time = first_at + np.arange(len(window.counts)) / window.sample_rate
    first = max(
        window.empty_begin, int(np.searchsorted(time, min(begin_at, 0.0) - parameters.lead_time))
    )
    return PassSignal(
        time[first:],
        window.force_between(first, len(window.counts)),
        Crossing(begin_at, max(end_at, begin_at + 1e-4), leave + begin_at, leave + end_at),
    )


class GaussMarkov(Estimator):
    """Generalised least squares on a learned model of the machine.

    Examples
    --------
    >>> print(round(GaussMarkov(GaussMarkovParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = GaussMarkovParameters()
    look = PlotStyle('Gauss-Markov', 'X', '#0058a3', '#7d9bff')
    folds = 2

    def __init__(self, parameters: GaussMarkovParameters) -> None:
        super().__init__(parameters)
        self._whitener = lru_cache(maxsize=32)(self._whitener_at)

    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the load in a window by the learned model.

        Without a learned model, the load is estimated by `estimate_untrained`. With a learned
        model, the variance of the load includes the variance of the zero. The load is NaN if the
        sample rate is not the sample rate of the model, the signal begins after the rise of the
        load, or the residual is larger than ``max_misfit`` allows.
        """
        known = self.parameters
        if not known.sample_rate:
            return estimate_untrained(window)
        used = pass_signal(window, known)
        other_rate = abs(window.sample_rate / known.sample_rate - 1) > _RATE_TOLERANCE
        if other_rate or len(used.time) == 0 or used.time[0] > used.crossing.on_end:
            return LoadEstimate(math.nan)
        whitener = self._whitener(round(window.belt_speed / _SPEED_STEP))
        zero_std_dev = max(window.zero_std_dev / abs(window.counts_per_kg), _LEAST_NOISE)
        impact = known.at('impact', window.belt_speed) * window.belt_speed
        signal = whitener.whiten(used.signal)
        mass, variance, misfit = hann_mean(raw_samples(window)), math.nan, math.nan
        # Each iteration changes only the values of the first five columns after the entry, so only
        # these values are whitened again.
        entry = int(np.searchsorted(used.time, used.crossing.on_begin))
        columns = np.ones((6, len(used.time)))
        whitened = np.empty(0)
        for _ in range(_MAX_ITERATIONS):
            columns[:5] = responses(known.platform, mass, used.crossing, used.time)
            if whitened.size:
                whitener.whiten_again(columns[:5], whitened[:5], entry)
            else:
                whitened = whitener.whiten(columns)
            kick = max(impact * abs(mass), _LEAST_NOISE)
            std_devs = (math.inf, _FREE, _FREE, kick, kick, zero_std_dev)
            last = mass
            mass, variance, misfit = least_squares(signal, whitened, std_devs)
            if not mass > 0 or abs(mass - last) <= _LEAST_CHANGE * abs(mass):
                break
        # Return no mass if the model does not fit, because the product may bounce or slip.
        return LoadEstimate(mass if misfit <= known.max_misfit else math.nan, variance)

    def _whitener_at(self, speed_step: int) -> Prewhitener:
        known, speed = self.parameters, speed_step * _SPEED_STEP
        return Prewhitener(
            known.row_at('reflection', speed), max(known.at('noise', speed), _LEAST_NOISE)
        )


def least_squares(
    signal: Array, columns: Array, std_devs: tuple[float, ...]
) -> tuple[float, float, float]:
    """Estimate the first coefficient of a regression with white noise of variance 1.

    The signal, (n,), is modelled as a linear combination of the rows of `columns`, (m, n).
    `std_devs` are the prior standard deviations of the coefficients, which are infinite for unknown
    coefficients. Returns the first coefficient, its variance, and the root mean square of the
    residual, which is about 1 if the model is valid. All three results are NaN if the regression is
    singular.

    Examples
    --------
    >>> rows = np.array([[1.0, 1.0], [1.0, -1.0]])
    >>> mass, variance, _ = least_squares(np.array([5.0, 1.0]), rows, (math.inf, math.inf))
    >>> print(round(mass, 9), round(variance, 9))
    3.0 0.5
    """
    normal = columns @ columns.T
    normal.ravel()[:: len(normal) + 1] += np.array(std_devs) ** -2.0
    try:
        inverse = np.linalg.inv(normal)
    except np.linalg.LinAlgError:
        return math.nan, math.nan, math.nan
    coefficients = inverse @ (columns @ signal)
    left = signal - coefficients @ columns
    return float(coefficients[0]), float(inverse[0, 0]), math.sqrt(float(left @ left) / len(left))


def estimate_untrained(window: WeighWindow) -> LoadEstimate:
    """Estimate the load in a window without training, by a noise model of the empty belt.

    The platform is unknown, but the belt excites its resonance. So an autoregression of the empty
    belt reduces the effect of ringing in the window. If the signal of the empty belt has fewer than
    six samples or no noise, the estimate is the Hann-weighted mean.
    """
    samples = raw_samples(window)
    t1, sample_rate = window.t1 or 0, window.sample_rate
    entry = math.floor(seconds(t1 - window.stamp) * sample_rate)
    empty = window.force_between(min(window.empty_begin, max(entry, 0)), max(entry, 0))
    order = min(_UNTRAINED_ORDER, len(empty) // 3)
    mean, std_dev = hann_mean(samples), 0.0
    if order >= 2 and np.all(np.isfinite(empty)) and np.ptp(empty) > 0:
        with np.errstate(invalid='ignore'):
            reflections, std_dev = pooled_reflections([empty - np.mean(empty)], order)
    # Return the mean also if the empty belt is exactly predictable, for example if two counts
    # alternate, because the autoregression then has no noise.
    if not std_dev > 0:
        return LoadEstimate(mean, float(np.var(samples)) / len(samples))
    whitener = Prewhitener(reflections, std_dev)
    level = whitener.whiten(np.ones((1, len(samples))))
    mass, variance, _ = least_squares(whitener.whiten(samples - mean), level, (math.inf,))
    return LoadEstimate(mean + mass, variance)
