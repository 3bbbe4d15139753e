"""Whether the scale agrees that a product was alone: its load changes no more than the belt shakes.

The eyes do not show a product whose edge was lost. The scale does: while one comes or goes within
the weigh window, the load changes by more than vibration and ring-down explain.
"""

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.averaging import mean, median

# Of the load. Ring-down of what has just entered changes it by up to 6 % of the windows.
_SHARE = 0.08
_VIBRATION = 6.0  # times the median change of the empty belt: the largest but for other items
_MEMORY = 0.98  # of that change at each further item
_FEWEST = 8  # samples


class LoadCheck:
    """Tell a steady load from one that something else came to or left.

    Compared are the mean of the last quarter of a window and that of its first half. What vibration
    does to their difference the empty belt before the items shows, over as many samples; where it
    is not empty for so long, what it showed last, or as long as it never was, what shorter
    stretches show: those shake more. The median of that: something may have left it. A belt that
    was never seen empty is taken for one that does not shake.
    """

    def __init__(self) -> None:
        self._shaking = 0.0  # counts
        self._is_of_window = False  # else of shorter stretches

    def is_steady(self, window: NDArray[np.int32], empty: NDArray[np.int32], zero: float) -> bool:
        """Tell whether the load of a window is that of one item.

        Parameters
        ----------
        window : ndarray, (n,) int32
            Counts from t2 to t3.
        empty : ndarray, (m,) int32
            Counts of the empty belt before t1, any number.
        zero : float
            Counts of the empty belt.
        """
        self._watch(empty, len(window))
        if len(window) < _FEWEST:
            return True
        load = abs(mean(window) - zero)
        change = abs(float(_changes(window.astype(np.float64), len(window))[0]))
        return change <= _SHARE * load + _VIBRATION * self._shaking

    def _watch(self, empty: NDArray[np.int32], size: int) -> None:
        whole = len(empty) >= size
        size = min(size, len(empty))
        if size < _FEWEST or (self._is_of_window and not whole):
            return
        counts = empty.astype(np.float64)
        if not whole:  # while something leaves that no eye has seen, the load falls evenly
            time = np.linspace(-1.0, 1.0, size)
            counts = counts - time * (time @ counts) / (time @ time)
        seen = median(np.abs(_changes(counts, size)))
        comparable = whole == self._is_of_window
        self._shaking = max(seen, _MEMORY * self._shaking) if comparable else seen
        self._is_of_window = whole


def _changes(counts: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return last quarter less first half of each stretch of `size` samples, (n - size + 1,)."""
    half, quarter = size // 2, size // 4
    number = len(counts) - size + 1
    sums = np.zeros(len(counts) + 1)
    np.cumsum(counts - counts[0], out=sums[1:])
    last = (sums[size:] - sums[size - quarter :][:number]) / quarter
    first = (sums[half:][:number] - sums[:number]) / half
    changes: NDArray[np.float64] = last - first
    return changes
