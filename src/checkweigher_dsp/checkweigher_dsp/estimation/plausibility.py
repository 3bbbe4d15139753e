# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Check whether the noise of a signal can come from a working analogue-to-digital converter.

Apart from impacts, platform and product add only smooth components to a signal. Above a quarter of
the sample rate, the signal contains mainly the white noise of the electronics, which does not
depend on the load. A high-pass filter, scaled to keep the variance of white noise, separates the
white noise from the signal. If the converter works, the filtered signal e and the readings, which
are the counts of the converter, have four properties (own derivation):

- The variance of e under a load, from t2 to t3, is at least as large as on the empty belt. The
  ratio of the variances has approximately an F distribution. Because the samples of e are
  correlated, each sample counts as 1 / sum r_k^2 degrees of freedom. r_k is the correlation of e at
  lag k, and the sum includes lag 0 and negative lags. If the signal is white noise, each sample
  counts as 0.48 degrees of freedom.
- From t1 to t3, the magnitude of e is not larger than noise and product explain. A larger magnitude
  shows a step of the signal that has another cause. The product causes an impact in proportion to
  load and speed, and a change of the slope at t1, t2 and t3.
- The readings do not repeat. If the standard deviation of the white noise is s counts, a
  prediction of a reading is right with a probability of at most p = erf(1 / (s sqrt 8)). So the
  probability that a sequence of w readings occurs twice among N readings is at most N^2 p^w / 2.
- The readings are seldom constant. Of n blocks of w readings, at most m = n p^(w-1) are expected to
  be constant. By the Chernoff bound, the probability of k or more constant blocks is at most
  (m / k)^k exp(k - m) for k > m. If this bound is very small, the signal repeatedly reaches a limit
  of the converter.

Rounding hides noise below 0.3 counts. If the noise is below 0.3 counts, or if there are too few
samples of the empty belt, only the steps are checked. If a quarter of the samples of e are 0, the
noise is too small to be measured, and nothing is checked.
"""

from functools import lru_cache, reduce
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.window_batch import time_since_entry
from checkweigher_dsp.signal import Array

# The filter is a seventh difference, equalised above a quarter of the sample rate. At 1/20 of the
# sample rate, where a platform may ring, the filter multiplies the amplitude of an oscillation by
# 4e-5.
_FILTER: NDArray[np.int64] = reduce(np.convolve, [np.array([1, -1])] * 7 + [np.array([5, 2])] * 3)
_EDGE = len(_FILTER) - 1  # number of samples by which the filter shortens a signal
_GAIN = math.sqrt(_FILTER @ _FILTER)
_STEP_GAIN = float(np.max(np.abs(np.cumsum(_FILTER)))) / _GAIN  # largest e after a step of 1.
# Largest e after a change of the slope by 1 per sample.
_SLOPE_GAIN = float(np.max(np.abs(np.cumsum(np.cumsum(_FILTER))))) / _GAIN
_QUARTILE = 0.3186  # first quartile of the absolute value of a standard normal variable
_ROUNDING = 1 / 12  # variance of the rounding error in counts^2
_FEWEST = 24  # smallest number of samples of e on the empty belt from which noise is measured
_CHANCE = 1e-5  # largest fraction of valid windows that a rule rejects by chance
_CALM = -4.26  # A standard normal variable is below this value with the probability `_CHANCE`.
# Samples of e on the empty belt are clipped to this many standard deviations, so that single
# outliers do not increase their variance.
_OUTLIER = 3.0
_LAGS = 20  # number of lags of the correlation of e
_BLOCKS = 2, 4, 8  # lengths of blocks in readings
_STEP = 7.0  # largest |e| that noise explains, in standard deviations of the noise
_STRIKE = 2e-3  # step due to the impact of a product, as a fraction of the load per m/s of speed


def is_plausible(window: WeighWindow) -> bool:
    """Return whether a working converter can have produced the signal of a window.

    The result is also True if the noise is too small to be measured, or if there are no samples of
    e. The fields of the window must be consistent, as checked by `is_consistent`.
    """
    begin, end = window.window_begin, window.window_end
    entry = int(np.searchsorted(time_since_entry(window, 0, end), 0.0))
    first = min(window.empty_begin, entry)
    counts = window.counts[first:end].astype(np.int64)
    counts -= counts[0]
    # The smallest step of the readings is above 1 if the lowest bits of the converter are always 0.
    step = int(np.gcd.reduce(counts)) or 1
    counts //= step
    rapid = np.convolve(counts, _FILTER)[_EDGE:-_EDGE] / _GAIN
    empty, loaded = rapid[: max(entry - first - _EDGE, 0)], rapid[entry - first :]
    known = empty if len(empty) >= _FEWEST else loaded
    if not len(known):
        return True
    quarter = len(known) // 4
    typical = float(np.partition(np.abs(known), quarter)[quarter] / _QUARTILE) ** 2
    if not typical:
        return True  # The noise is too small to be measured.
    load = abs(float(window.counts[begin:end].mean()) - window.zero) / step
    explained = _impact(load, window.belt_speed, begin - entry, end - entry, len(loaded))
    if np.any(loaded * loaded > _STEP**2 * max(typical, _ROUNDING) + explained * explained):
        return False
    if typical < 2 * _ROUNDING or known is loaded:
        return True
    limit = _OUTLIER * math.sqrt(typical)
    calmer = _is_calmer(rapid[begin - first :], np.clip(empty, -limit, limit))
    predicted = math.erf(1 / math.sqrt(8 * (typical - _ROUNDING)))
    level = counts[begin - first :]
    return not (calmer or _is_repeated(counts, predicted) or _stands_still(level, predicted))


def _impact(load: float, speed: float, entered: int, leaves: int, count: int) -> Array:
    """Return the largest e that a product causes in each of `count` samples after t1, (count,).

    `load` is in the unit of e, which is the smallest step of the readings, and `speed` is in m/s.
    `entered` and `leaves` are t2 and t3 in samples from t1.
    """
    largest = np.full(count, _STRIKE * speed * load * _STEP_GAIN)
    # The slope of the load changes at t1, where the load begins to rise, at t2, where it is
    # complete, and at t3, where it begins to fall.
    for corner in (0, entered, leaves):
        near = slice(max(corner - 2 * _EDGE, 0), corner + _EDGE)
        largest[near] += load / max(entered, 1) * _SLOPE_GAIN
    return largest


def _is_calmer(level: Array, empty: Array) -> bool:
    """Return whether an F test shows that e has less variance under a load than on the empty belt.

    `level` and `empty` are e under the load and on the empty belt. The approximation of Paulson
    (1942) converts the ratio of their variances to a standard normal deviate. The result is False
    if `level` is empty.
    """
    if not len(level):
        return False
    power = float(empty @ empty)
    alike = sum((float(empty[:-lag] @ empty[lag:]) / power) ** 2 for lag in range(1, _LAGS))
    first, second = (2 * (1 + 2 * alike) / (9 * len(each)) for each in (level, empty))
    root = math.cbrt(float(level @ level) / len(level) / power * len(empty))
    deviate = ((1 - second) * root - (1 - first)) / math.sqrt(first + second * root * root)
    return deviate < _CALM


def _stands_still(level: NDArray[np.int64], predicted: float) -> bool:
    """Return whether more blocks of readings are constant than chance explains.

    `level` contains the readings from t2 to t3, and `predicted` is p, the largest probability of
    predicting a reading.
    """
    for width in _BLOCKS:
        blocks = level[: len(level) // width * width].reshape(-1, width)
        found = np.count_nonzero((blocks == blocks[:, :1]).all(axis=1))
        expected = len(blocks) * predicted ** (width - 1)
        surplus = found - expected
        if surplus > 0 and found * math.log(found / expected) - surplus > -math.log(_CHANCE):
            return True
    return False


def _is_repeated(counts: NDArray[np.int64], predicted: float) -> bool:
    """Return whether a sequence of readings that is too long to repeat by chance occurs twice.

    `predicted` is p, the largest probability of predicting a reading.
    """
    length = math.ceil(math.log(2 * _CHANCE / len(counts) ** 2) / math.log(predicted))
    if length >= len(counts):
        return False
    keys = np.sort(np.convolve(counts, _factors(length), 'valid'))
    return bool(np.any(keys[1:] == keys[:-1]))


@lru_cache(maxsize=64)
def _factors(length: int) -> NDArray[np.int64]:
    """Return the factors, (length,), of a hash of `length` readings.

    The hash is the sum of the readings multiplied by the factors. The factors are pseudorandom, and
    depend only on `length`.
    """
    return np.random.Generator(np.random.PCG64(length)).integers(-(2**62), 2**62, length)
