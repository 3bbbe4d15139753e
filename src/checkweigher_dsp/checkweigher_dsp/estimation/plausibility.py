# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Check of the signal of a window against the noise of its own empty belt.

Platform and product add only smooth components to a signal. Above a quarter of the sample rate
there is little but the white noise of the electronics, which does not depend on the load. A
high-pass filter, scaled to keep the variance of white noise, shows the converter alone. [own
derivation] If the converter works, the filtered signal e

- is no calmer under a load: its variance from t2 to t3 is at least that on the empty belt. The
  ratio has an F distribution; because e is correlated, a sample counts as 1 over the sum of its
  squared correlations in degrees of freedom, 0.48 for white noise;
- has no steps from t1 to t3 except those explained by the noise and by the product, which strikes
  the belt in proportion to load and speed, and changes the slope of the load at t1, t2 and t3;
- never repeats itself: with white noise of s counts, nothing predicts more than a share
  p = erf(1 / (s sqrt 8)) of the readings. So among N readings, a sequence of w readings occurs
  twice in at most N^2 p^w / 2 of all windows;
- seldom stands still: of n blocks of w readings, more than m = n p^(w-1) consist of one value by
  chance. By the bound of Chernoff there are k > m of them in at most (m / k)^k exp(k - m) of all
  windows. This shows a limit that the load crosses again and again.

Noise below 0.3 counts is hidden by the rounding. Then, and if no empty belt is seen, only the steps
are judged. A converter that shows no noise at all is not judged.
"""

from functools import lru_cache, reduce
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.window_batch import time_since_entry

# The seventh difference, equalised above a quarter of the sample rate. It reduces a line at a
# twentieth of the sample rate, at which a platform may ring, to 2e-5.
_FILTER: NDArray[np.int64] = reduce(np.convolve, [np.array([1, -1])] * 7 + [np.array([5, 2])] * 3)
_EDGE = len(_FILTER) - 1  # samples at each end that it cannot filter
_GAIN = math.sqrt(_FILTER @ _FILTER)
_STEP_GAIN = float(np.max(np.abs(np.cumsum(_FILTER)))) / _GAIN  # largest e from a step of 1
# Largest e from a change of the slope by 1 per sample.
_SLOPE_GAIN = float(np.max(np.abs(np.cumsum(np.cumsum(_FILTER))))) / _GAIN
_QUARTILE = 0.3186  # of the absolute values of a normal distribution, standard deviations
_ROUNDING = 1 / 12  # counts^2
_FEWEST = 24  # filtered samples of the empty belt that show its noise
# Largest share of sound windows that the first and the third rule refuse by chance.
_CHANCE = 1e-5
_CALM = -4.26  # the same as a standard normal deviate
_OUTLIER = 3.0  # standard deviations; larger values of the empty belt are clipped
_LAGS = 20  # of the correlation of e
_BLOCKS = 2, 4, 8  # readings
_STEP = 7.0  # standard deviations of the noise
_STRIKE = 2e-3  # s/m, step by the strike of a product: share of the load per m/s


def is_plausible(window: WeighWindow) -> bool:
    """Return whether a consistent window may be the signal of a product on the belt."""
    begin, end = window.window_begin, window.window_end
    entry = int(np.searchsorted(time_since_entry(window, 0, end), 0.0))
    first = min(window.empty_begin, entry)
    counts = window.counts[first:end].astype(np.int64)
    counts -= counts[0]
    step = int(np.gcd.reduce(counts)) or 1  # above 1 if the lowest bits are always 0
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
    explained = np.full(len(loaded), _STRIKE * window.belt_speed * load * _STEP_GAIN)
    # A scale without lag shows corners where the load begins to rise, is complete, and falls.
    for corner in (0, begin - entry, end - entry):
        near = slice(max(corner - 2 * _EDGE, 0), corner + _EDGE)
        explained[near] += load / max(begin - entry, 1) * _SLOPE_GAIN
    if np.any(np.abs(loaded) > np.hypot(_STEP * math.sqrt(max(typical, _ROUNDING)), explained)):
        return False
    if typical < 2 * _ROUNDING or known is loaded:
        return True
    limit = _OUTLIER * math.sqrt(typical)
    calmer = _is_calmer(rapid[begin - first :], np.clip(empty, -limit, limit))
    predicted = math.erf(1 / math.sqrt(8 * (typical - _ROUNDING)))
    level = counts[begin - first :]
    return not (calmer or _is_repeated(counts, predicted) or _stands_still(level, predicted))


def _is_calmer(level: NDArray[np.float64], empty: NDArray[np.float64]) -> bool:
    """Return whether a signal has less variance than the empty belt, by an F test.

    The cube roots of Paulson (1942) turn the ratio into a standard normal deviate.
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
    """Return whether too many blocks of readings consist of one value for chance."""
    for width in _BLOCKS:
        blocks = level[: len(level) // width * width].reshape(-1, width)
        found = np.count_nonzero(np.ptp(blocks, axis=1) == 0)
        expected = len(blocks) * predicted ** (width - 1)
        surplus = found - expected
        if surplus > 0 and found * math.log(found / expected) - surplus > -math.log(_CHANCE):
            return True
    return False


def _is_repeated(counts: NDArray[np.int64], predicted: float) -> bool:
    """Return whether a sequence of readings occurs twice that is too long for chance."""
    length = math.ceil(math.log(2 * _CHANCE / len(counts) ** 2) / math.log(predicted))
    if length >= len(counts):
        return False
    keys = np.sort(np.convolve(counts, _factors(length), 'valid'))
    return bool(np.any(keys[1:] == keys[:-1]))


@lru_cache(maxsize=64)
def _factors(length: int) -> NDArray[np.int64]:
    """Return random factors (length,) by which a sequence of readings is hashed to a number."""
    return np.random.Generator(np.random.PCG64(length)).integers(-(2**62), 2**62, length)
