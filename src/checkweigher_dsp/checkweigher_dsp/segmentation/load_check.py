# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Load check: the load of a single product is steady, except for the vibration of the belt.

The eyes do not show a product whose edge was lost, but the scale does: if it comes or goes within
the weigh window, the load changes by more than vibration and ring-down explain.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# Largest change as a share of the load; the ring-down after the entry explains up to 6 %.
_SHARE = 0.08
_VIBRATION = 6.0  # largest change by vibration, in median changes of the empty belt
_MEMORY = 0.98  # factor by which that median decreases at each item
_FEWEST = 8  # samples


class LoadCheck:
    """Check whether a load is steady, so that no other item came or left meanwhile.

    The check compares the mean of the last quarter of a window with that of its first half. The
    effect of vibration on this difference is measured on all segments of the empty belt that have
    the same length. Their median is used, because another item may have left meanwhile. If the
    empty belt is shorter than a window, the previous value is kept; without one, shorter segments
    are used, which vary more. Until an empty belt is seen, no vibration is assumed.
    """

    def __init__(self) -> None:
        self._shaking = 0.0  # counts
        self._is_of_window = False  # else of shorter segments

    def is_steady(self, window: NDArray[np.int32], empty: NDArray[np.int32], zero: float) -> bool:
        """Return whether a window, (n,) counts from t2 to t3, contains the load of one item only.

        `empty` are the counts of the empty belt before t1, shape (m,); `zero` is its reading.
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
        if not whole:  # remove the even fall of the load while an unseen item leaves
            time, power = _time(size)
            counts -= time * (time @ counts) / power
        changes = _changes(counts, size)
        seen = float(np.median(np.abs(changes, out=changes)))
        self._shaking = max(seen, _MEMORY * self._shaking) if whole == self._is_of_window else seen
        self._is_of_window = whole


def is_unloaded(counts: NDArray[np.int32], size: int, zero: float) -> bool:
    """Return whether the items that came onto the belt during `counts`, shape (n,), have left it.

    The last `size` counts are compared with the `size` counts of the largest load; `zero` is the
    reading of the empty belt.
    """
    number = len(counts) // size if size > 0 else 0
    if number < 2:
        return False
    loads = np.abs(counts[len(counts) - number * size :].reshape(number, size).mean(axis=1) - zero)
    return bool(loads[-1] <= _SHARE * loads.max())


def _changes(counts: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return the mean of last quarter minus first half of each `size` samples, (n - size + 1,)."""
    half, quarter = size // 2, size // 4
    number = len(counts) - size + 1
    sums = np.zeros(len(counts) + 1)
    np.add.accumulate(counts - counts[0], out=sums[1:])
    changes = sums[size:] - sums[size - quarter : len(sums) - quarter]
    changes /= quarter
    first = sums[half : half + number] - sums[:number]
    first /= half
    changes -= first
    return changes


@lru_cache(maxsize=64)
def _time(size: int) -> tuple[NDArray[np.float64], float]:
    """Return evenly spaced times, (size,) from -1 to 1, and the sum of their squares."""
    time = np.linspace(-1.0, 1.0, size)
    time.flags.writeable = False
    return time, float(time @ time)
