# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimates from one pass of a machine without training, and their uncertainty.

The only assumption is that the load is constant in the window; nothing is assumed of the platform
or the rise. [own derivation, docs/method.md]
"""

from dataclasses import replace
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.load_rise import load_share
from checkweigher_dsp.denoising.window_batch import rise_time, time_since_entry, transit
from checkweigher_dsp.estimation.estimators.base import LoadEstimate, is_in_window, raw_samples
from checkweigher_dsp.signal.autoregression import pooled_autocovariance
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.rise_lag import PLATFORM_LAG, lag_of

_PARTS = 64  # least number of parts of a window: up to some 80 Hz on a slow belt
# Additional noise, as shares of the variance of the disturbance in a window. From t2 on, ring-down
# and a late load reach far into the window; at t3 only a misplaced eye matters.
_ENTRY_NOISE = 0.05
_EXIT_NOISE = 0.001
_EDGE_EXPONENT = 1.5  # of the growth of both there, a power of the inverse of half a Hann window
_WHITE = 1e-3  # share of that variance; keeps the weights bounded for a single line
_ITERATIONS = 2
SETTLE_TIME = 0.1  # s after the previous item, as in the segmenter
_RISE_PARTS = 3  # each longer than a period of most platforms, whose ringing averages out
# Stated share of the level's standard deviation by its spectrum, which treats fading ringing as if
# it continued. Measured on 21 machines without a model.
_STATED = 0.6


def doubt(window: WeighWindow, load: LoadEstimate) -> LoadEstimate:
    """Return an estimate that uses the rise, drawn towards `window_level` if the rise does not fit.

    Each is weighted by the inverse of its variance. The variance of `load` grows with the residual
    between t1 and t2 and with the lag of the rise. Both are caused by misplaced photo-eyes,
    bounces, or an unexpected platform or amplifier, and both leave an area that smoothing spreads
    over the pass. A single pass cannot show whether a rise that fits is misleading, so the stated
    variance is that of the level alone.
    """
    if not is_in_window(load, window):
        return load  # the load changed during the rise; the identifier refuses it
    level, deviation = window_level(window)
    misplaced = load.mass * lag_doubt(window) / (2 * transit(window))
    misfit = rise_misfit(window, load.mass) * rise_time(window) / transit(window)
    by_rise = load.variance + misfit**2 + misplaced**2
    by_level = deviation**2
    total = by_rise + by_level
    if not total > 0:  # also if NaN
        return load
    mass = (by_level * load.mass + by_rise * level) / total
    variance = (_STATED * deviation) ** 2
    return replace(load, mass=mass, variance=variance, b1=load.b1 * (mass / load.mass))


def window_level(window: WeighWindow) -> tuple[float, float]:
    """Return the level of a window, kg, and its standard deviation, from its own spectrum.

    The Gauss-Markov weights are used, for the autocovariance of the window about its level plus
    that of the empty belt before it. They are close to a plain mean for a broadband disturbance,
    and to a window without side lobes for lines. Additional noise grows towards t2, where ring-down
    and an incomplete load would enter, and close to t3.
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
    """Return the rms residual in kg of an evenly rising load of `mass` between t1 and t2.

    The load is as late as on the assumed platform. The residual is computed from the means of the
    thirds of the rise, so that ringing averages out. Only its excess over the noise of the empty
    belt counts.
    """
    time = time_since_entry(window)
    entry = max(int(np.searchsorted(time, 0.0)), window.empty_begin)
    left = window.force - mass * load_share(time - PLATFORM_LAG, rise_time(window))
    size = (window.window_begin - entry) // _RISE_PARTS
    if size < 1:
        return 0.0
    rise = _means(left[entry : window.window_begin], size)
    empty = _means(_empty_belt(window), size)
    noise = float(np.mean(empty * empty)) if len(empty) else 0.0
    return math.sqrt(max(float(np.mean(rise * rise)) - noise, 0.0))


def lag_doubt(window: WeighWindow) -> float:
    """Return the deviation of the rise from its assumed lag with its uncertainty, rms in s.

    It is 0 if too little of the empty belt is seen, as close behind another product.
    """
    seen = lag_of(window)
    return math.hypot(seen.lag - PLATFORM_LAG, seen.std_dev) if seen.is_known else 0.0


def _empty_belt(window: WeighWindow) -> NDArray[np.float64]:
    """Return the signal of the empty belt before an item, kg, without the ring-down before it."""
    entry = int(np.searchsorted(time_since_entry(window), 0.0))
    begin = window.empty_begin + round(SETTLE_TIME * window.sample_rate)
    return window.force_between(min(begin, entry), entry)


def _means(signal: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return the means of successive parts of `size` samples, the last ones of a signal."""
    return np.asarray(signal[len(signal) % size :].reshape(-1, size).mean(axis=1))
