# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Check of the signal of a window against the noise of its own empty belt.

What platform and product add to a signal is smooth: above a quarter of the sample rate there is
little but the white noise of the electronics, and that does not depend on the load. A high-pass
filter, scaled to leave the variance of white noise as it is, shows the converter alone. [own
derivation] Of a converter that works, the filtered signal e

- is no calmer under a load: from t2 to t3 it has at least the variance that it has on the empty
  belt. Their ratio is distributed as F; e is correlated, so that a sample is 1 over the sum of its
  squared correlations in degrees of freedom, 0.48 for white noise;
- has no steps from t1 to t3 beyond what the noise explains and what a product explains: it strikes
  the belt, in proportion to load and speed, and at t1, t2 and t3 the slope of the load changes;
- never repeats itself: with white noise of s counts nothing predicts more than a share
  p = erf(1 / (s sqrt 8)) of the readings. So among N readings a sequence of w is found twice in at
  most N^2 p^w / 2 of all windows.

Noise below 0.3 counts is hidden by the rounding: then only the steps are judged, as they are where
no empty belt is seen. A converter that shows no noise at all is not judged.
"""

from functools import lru_cache, reduce
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.window_batch import time_since_entry

# The seventh difference, made flat above a quarter of the sample rate. Of a line at a twentieth of
# the sample rate, as a platform may ring, 2e-5 is left.
_FILTER: NDArray[np.int64] = reduce(np.convolve, [np.array([1, -1])] * 7 + [np.array([5, 2])] * 3)
_EDGE = len(_FILTER) - 1  # samples at each end that it cannot be applied to
_GAIN = math.sqrt(_FILTER @ _FILTER)
_STEP_GAIN = float(np.max(np.abs(np.cumsum(_FILTER)))) / _GAIN  # largest e of a step of 1
# Largest e where the slope changes by 1 a sample.
_SLOPE_GAIN = float(np.max(np.abs(np.cumsum(np.cumsum(_FILTER))))) / _GAIN
_QUARTILE = 0.3186  # of the absolute values of a normal distribution, standard deviations
_ROUNDING = 1 / 12  # counts^2
_FEWEST = 24  # filtered samples of the empty belt that show its noise
# Sound windows that the first and the third rule refuse by chance, at most.
_CHANCE = 1e-5
_CALM = -4.26  # the same as a deviate of the normal distribution
_OUTLIER = 3.0  # standard deviations, of what shook the belt once
_LAGS = 20  # of the correlation of e
_STEP = 7.0  # standard deviations of the noise
_STRIKE = 2e-3  # s/m, of a product, as a step: share of the load for each m/s


def is_plausible(window: WeighWindow) -> bool:
    """Return whether a consistent window can be the signal of a product on the belt."""
    begin, end = window.window_begin, window.window_end
    entry = int(np.searchsorted(time_since_entry(window, 0, end), 0.0))
    first = min(window.empty_begin, entry)
    counts = window.counts[first:end].astype(np.int64)
    counts -= counts[0]
    step = int(np.gcd.reduce(counts)) or 1  # of a converter whose lowest bits are always 0
    counts //= step
    rapid = np.convolve(counts, _FILTER)[_EDGE:-_EDGE] / _GAIN
    empty, loaded = rapid[: max(entry - first - _EDGE, 0)], rapid[entry - first :]
    known = empty if len(empty) >= _FEWEST else loaded
    if not len(known):
        return True
    typical = float(np.sort(np.abs(known))[len(known) // 4] / _QUARTILE) ** 2
    if not typical:
        return True  # a converter that shows no noise
    load = abs(float(window.counts[begin:end].mean()) - window.zero) / step
    strike = _STRIKE * window.belt_speed * load * _STEP_GAIN
    explained = np.full(len(loaded), strike)
    # A scale that follows at once shows where the load begins to rise, is complete, and falls.
    for corner in (0, begin - entry, end - entry):
        near = slice(max(corner - 2 * _EDGE, 0), corner + _EDGE)
        explained[near] += load / max(begin - entry, 1) * _SLOPE_GAIN
    if np.any(np.abs(loaded) > np.hypot(_STEP * math.sqrt(max(typical, _ROUNDING)), explained)):
        return False
    if typical < 2 * _ROUNDING or known is loaded:
        return True
    limit = _OUTLIER * math.sqrt(typical)
    if _is_calmer(rapid[begin - first :], np.clip(empty, -limit, limit)):
        return False
    return not _is_repeated(counts, math.sqrt(typical - _ROUNDING))


def _is_calmer(level: NDArray[np.float64], empty: NDArray[np.float64]) -> bool:
    """Return whether a signal has less variance than that of the empty belt, by the test of F.

    The ratio becomes a deviate of the normal distribution by the cube roots of Paulson (1942).
    """
    if not len(level):
        return False
    power = float(empty @ empty)
    alike = sum((float(empty[:-lag] @ empty[lag:]) / power) ** 2 for lag in range(1, _LAGS))
    first, second = (2 * (1 + 2 * alike) / (9 * len(each)) for each in (level, empty))
    root = math.cbrt(float(level @ level) / len(level) / power * len(empty))
    deviate = ((1 - second) * root - (1 - first)) / math.sqrt(first + second * root * root)
    return deviate < _CALM


def _is_repeated(counts: NDArray[np.int64], noise: float) -> bool:
    """Return whether a sequence of readings is there twice that is too long for chance."""
    predicted = math.erf(1 / (noise * math.sqrt(8)))
    length = math.ceil(math.log(2 * _CHANCE / len(counts) ** 2) / math.log(predicted))
    if length >= len(counts):
        return False
    keys = np.sort(np.convolve(counts, _factors(length), 'valid'))
    return bool(np.any(keys[1:] == keys[:-1]))


@lru_cache(maxsize=64)
def _factors(length: int) -> NDArray[np.int64]:
    """Return random factors (length,) that make one number of a sequence of readings."""
    return np.random.Generator(np.random.PCG64(length)).integers(-(2**62), 2**62, length)
