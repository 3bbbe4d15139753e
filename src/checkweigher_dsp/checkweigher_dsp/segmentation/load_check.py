# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Check whether the load is constant in a weigh window.

The photo-eyes do not show a product whose edge was lost. If an unseen product enters or leaves
during a weigh window, the load changes by more than vibration and ring-down explain.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal import Array

# Largest change of a constant load, as a fraction of the load. The ring-down after the entry of an
# item changes the load by up to 6 %.
_SHARE = 0.08
_VIBRATION = 6.0  # largest change due to vibration, divided by the median change of the empty belt
_MEMORY = 0.98  # smallest ratio of the median change to its value at the previous item
_FEWEST = 8  # minimum number of samples in a window or segment that is checked


class LoadCheck:
    """Check that the load is constant in a weigh window.

    The load changes if another item enters or leaves during the window. The check compares the
    mean of the last quarter of a window with the mean of the first half. The effect of vibration on
    this difference is estimated as the median of its magnitude over all segments of the empty belt
    that have the length of the window. A median is used because an unseen item may leave the belt
    during some of these segments.

    If the signal of the empty belt is shorter than the window, the last median over segments with
    the length of a window is kept. Until the first median of this kind, the whole signal of the
    empty belt is used as one segment. Before the first signal of an empty belt, no vibration is
    assumed.
    """

    def __init__(self) -> None:
        self._shaking = 0.0  # median change of the empty belt in counts.
        # Whether the median change was computed from segments with the length of a window.
        self._is_of_window = False

    def is_steady(self, window: NDArray[np.int32], empty: NDArray[np.int32], zero: float) -> bool:
        """Return whether the load is constant in a window, so that no other item enters or leaves.

        `window`, (n,), contains the counts while the item is fully on the belt, and `empty`, (m,),
        the counts of the empty belt before the item. `zero` is the zero in counts. If the window
        has fewer than eight samples, the result is True.
        """
        size = len(window)
        self._watch(empty, size)
        if size < _FEWEST:
            return True
        counts = window.astype(np.float64)
        load = abs(float(np.mean(counts)) - zero)
        counts -= counts[0]
        change = abs(float(np.mean(counts[size - size // 4 :]) - np.mean(counts[: size // 2])))
        return change <= _SHARE * load + _VIBRATION * self._shaking

    def _watch(self, empty: NDArray[np.int32], size: int) -> None:
        whole = len(empty) >= size
        size = min(size, len(empty))
        if size < _FEWEST or (self._is_of_window and not whole):
            return
        counts = empty.astype(np.float64)
        if not whole:
            # Subtract a linear trend, because the load falls linearly while an unseen item leaves,
            # and this fall is no vibration.
            time, power = _time(size)
            counts -= time * (time @ counts) / power
        changes = _changes(counts, size)
        seen = float(np.median(np.abs(changes, out=changes)))
        self._shaking = max(seen, _MEMORY * self._shaking) if whole == self._is_of_window else seen
        self._is_of_window = whole


def is_unloaded(counts: NDArray[np.int32], size: int, zero: float) -> bool:
    """Return whether the items that entered during the samples `counts`, (n,), have left.

    The samples are divided into successive parts of `size` samples. The items have left if the mean
    load of the last part is at most 8 % of the largest mean load of a part. `zero` is the zero in
    counts. If there are fewer than two parts, the result is False.
    """
    number = len(counts) // size if size > 0 else 0
    if number < 2:
        return False
    loads = np.abs(counts[len(counts) - number * size :].reshape(number, size).mean(axis=1) - zero)
    return bool(loads[-1] <= _SHARE * loads.max())


def _changes(counts: Array, size: int) -> Array:
    """Return the mean of the last quarter minus the mean of the first half of each segment.

    The segments are all runs of `size` successive samples. For n samples, the shape of the result
    is (n - size + 1,).
    """
    half, quarter = size // 2, size // 4
    sums = np.append(0.0, np.cumsum(counts - counts[0]))
    number = len(sums) - size
    last = sums[size:] - sums[size - quarter : size - quarter + number]
    first = sums[half : half + number] - sums[:number]
    return last / quarter - first / half


@lru_cache(maxsize=64)
def _time(size: int) -> tuple[Array, float]:
    """Return evenly spaced times from -1 to 1, (size,), and the sum of their squares."""
    time = np.linspace(-1.0, 1.0, size)
    time.flags.writeable = False
    return time, float(time @ time)
