# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimates of the load, and of their uncertainty, for a machine whose estimator is not trained.

`window_level` assumes only a constant load in the window. `doubt`, `rise_misfit` and `lag_doubt`
compare the rise of the load with an even rise on the default platform (own derivation, see
docs/method.md).
"""

from dataclasses import replace
import math

import numpy as np

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.load_rise import load_share
from checkweigher_dsp.denoising.window_batch import rise_time, time_since_entry, transit
from checkweigher_dsp.estimation.estimators.base import LoadEstimate, is_in_window, raw_samples
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.autoregression import pooled_autocovariance
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.rise_lag import PLATFORM_LAG, lag_of

# Smallest number of parts of a window, which resolve 80 Hz on a slow belt. If a window has fewer
# than `_PARTS` samples, each sample is a part.
_PARTS = 64
# Additional noise at both ends of a window, as fractions of the variance of the disturbance. The
# additional noise is larger at t2 than at t3, because ring-down and a late load extend far into the
# window.
_ENTRY_NOISE = 0.05
_EXIT_NOISE = 0.001
_EDGE_EXPONENT = 1.5  # exponent of the additional noise near both ends.
# White noise as a fraction of the variance of the disturbance. Without white noise, the weights
# might become very large if the disturbance is a single oscillation.
_WHITE = 1e-3
_ITERATIONS = 2
SETTLE_TIME = 0.1  # duration in s of the ring-down after the previous item has left.
# Number of parts of the rise. A part of the rise lasts at least about one period of most platforms.
_RISE_PARTS = 3
# Factor by which the standard deviation of the level is multiplied. Without this factor, the
# standard deviation is too large, because ringing decays within the window. The factor was measured
# on 21 machines that no estimator was trained on.
_STATED = 0.6


def doubt(window: WeighWindow, load: LoadEstimate) -> LoadEstimate:
    """Return the weighted mean of `window_level` and of an estimate that uses the rise of the load.

    The estimate `load` is returned unchanged if `is_in_window` is False for it, or if the sum of
    the variances of level and estimate is 0 or unknown. Level and estimate are weighted by their
    inverse variances. The variance of `load` is increased by the residual between t1 and t2, and by
    the difference between the lag of the rise and the lag of the default platform. A residual or a
    different lag is caused by misplaced photo-eyes, bounces, or an unexpected platform or
    amplifier. Smoothing spreads the effect of a wrong rise over the pass. The standard deviation of
    the result is `_STATED` times the standard deviation of the level, because the rise of a single
    pass may also fit a wrong estimate.
    """
    if not is_in_window(load, window):
        return load  # The identifier rejects a load that is far from the mean of the samples.
    level, deviation = window_level(window)
    misplaced = load.mass * lag_doubt(window) / (2 * transit(window))
    misfit = rise_misfit(window, load.mass) * rise_time(window) / transit(window)
    by_rise = load.variance + misfit**2 + misplaced**2
    by_level = deviation**2
    total = by_rise + by_level
    if not total > 0:  # The total may be NaN.
        return load
    mass = (by_level * load.mass + by_rise * level) / total
    variance = (_STATED * deviation) ** 2
    return replace(load, mass=mass, variance=variance, b1=load.b1 * (mass / load.mass))


def window_level(window: WeighWindow) -> tuple[float, float]:
    """Return the level of a window, which is a weighted mean, and its standard deviation, in kg.

    The weights of the samples are Gauss-Markov weights. The covariance of the disturbance is the
    sum of two autocovariances: of the window about its level, and of the empty belt before the
    window. For a broadband disturbance, the level is close to a plain mean. For spectral lines, the
    level is close to a mean with smooth weights. Additional noise reduces the weights near t3 and
    even more near t2, where ringing and an incomplete load may remain. Without a disturbance, the
    level is the Hann-weighted mean, and the standard deviation is 0.
    """
    samples = raw_samples(window)
    size = max(len(samples) // _PARTS, 1)
    parts, empty = _means(samples, size), _means(_empty_belt(window), size)
    count = len(parts)
    after_entry = np.sin(np.pi / 2 * np.arange(1, count + 1) / (count + 1)) ** 2
    before_exit = 1 - after_entry
    edges = _ENTRY_NOISE / after_entry**_EDGE_EXPONENT + _EXIT_NOISE / before_exit**_EDGE_EXPONENT
    lags = abs(np.subtract.outer(np.arange(count), np.arange(count)))
    level, deviation = float(hann_mean(samples)), 0.0
    belt = pooled_autocovariance([empty], count)
    for _ in range(_ITERATIONS):
        covariance = pooled_autocovariance([parts - level], count) + belt
        scale = covariance[0]
        if not scale > 0:
            break
        noise = covariance[lags]
        weights = np.linalg.solve(noise + np.diag(scale * (edges + _WHITE)), np.ones(count))
        weights /= weights.sum()
        level = float(np.add.reduce(weights * parts))
        deviation = float(np.sqrt(max(weights @ noise @ weights, 0.0)))
    return level, deviation


def rise_misfit(window: WeighWindow, mass: float) -> float:
    """Return the rms deviation in kg of the signal between t1 and t2 from an even rise of the load.

    The assumed load rises linearly to `mass` in kg, and lags by the delay of the default platform.
    The deviation is computed from the means of parts of about a third of the rise, so that ringing
    averages out. The power of the means of equally long parts of the empty belt is subtracted,
    because it is noise. The result is 0 if no power remains, or if the rise has fewer than three
    samples.
    """
    entry, begin = max(_entry(window), window.empty_begin), window.window_begin
    size = (begin - entry) // _RISE_PARTS
    if size < 1:
        return 0.0
    time = time_since_entry(window, entry, begin) - PLATFORM_LAG
    left = window.force_between(entry, begin) - mass * load_share(time, rise_time(window))
    rise, empty = _means(left, size), _means(_empty_belt(window), size)
    noise = float(np.mean(empty * empty)) if len(empty) else 0.0
    return math.sqrt(max(float(np.mean(rise * rise)) - noise, 0.0))


def lag_doubt(window: WeighWindow) -> float:
    """Return the rms difference in s between the lags of the rise and of the default platform.

    The difference includes the uncertainty of the lag. The result is 0 if the lag is unknown, for
    example because the empty belt before the product is too short.
    """
    seen = lag_of(window)
    return math.hypot(seen.lag - PLATFORM_LAG, seen.std_dev) if seen.is_known else 0.0


def _empty_belt(window: WeighWindow) -> Array:
    """Return the signal of the empty belt in kg before t1, without ring-down of the previous item.

    The result is empty if t1 is within the ring-down.
    """
    entry = _entry(window)
    begin = window.empty_begin + round(SETTLE_TIME * window.sample_rate)
    return window.force_between(min(begin, entry), entry)


def _entry(window: WeighWindow) -> int:
    """Return the position of the first sample at or after t1."""
    return int(time_since_entry(window).searchsorted(0.0))


def _means(signal: Array, size: int) -> Array:
    """Return the means of successive parts of `size` samples, aligned to the end of a signal."""
    return np.asarray(signal[len(signal) % size :].reshape(-1, size).mean(axis=1))
