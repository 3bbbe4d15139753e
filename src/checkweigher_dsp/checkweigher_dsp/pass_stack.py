"""Stacks of passes: windows of equal shape as arrays, so that many can be computed at once."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.continuation import PREDICTION_RATE
from checkweigher_dsp.load_rise import load_share
from checkweigher_dsp.records import MAX_SAMPLE_RATE, NANOSECONDS, WeighWindow
from checkweigher_dsp.wavelet_shrinkage import LEVELS

_PERIOD = 2**LEVELS
# The signal before t2 is taken in steps of this, so that few shapes come about.
_LEAD_STEP = 16


@dataclass(frozen=True, slots=True)
class PassStack:
    """Passes of equal shape, to be denoised at once.

    Attributes
    ----------
    positions : tuple of int
        Which of the windows these are.
    force : ndarray, (passes, n) float64
        kg, from some empty belt before t1 up to t3.
    time : ndarray, (passes, n) float64
        s since t1.
    rise_time : ndarray, (passes, 1) float64
        s, t2 - t1.
    belt_speed : ndarray, (passes,) float64
        m/s.
    entry, begin : int
        Columns of the first sample at or after t1, and at or after t2.
    block : int
        Samples in one block of the prediction.
    """

    positions: tuple[int, ...]
    force: NDArray[np.float64]
    time: NDArray[np.float64]
    rise_time: NDArray[np.float64]
    belt_speed: NDArray[np.float64]
    entry: int
    begin: int
    block: int

    @property
    def share(self) -> NDArray[np.float64]:
        """Share of the product on the belt at each sample: (passes, n) float64."""
        return load_share(self.time, self.rise_time)


def stack_passes(windows: Sequence[WeighWindow], min_length: int) -> list[PassStack]:
    """Sort windows by shape into stacks.

    Parameters
    ----------
    windows : sequence of WeighWindow
        Consistent ones.
    min_length : int
        Of the stretch: half of it, at most, is taken from before t2.
    """
    shapes: dict[tuple[int, int, int], list[int]] = {}
    for position, window in enumerate(windows):
        shape = (*_extent(window, min_length), _block(window))
        shapes.setdefault(shape, []).append(position)
    stacks = []
    for (lead, count, block), positions in shapes.items():
        members = [windows[position] for position in positions]
        time = np.stack([time_since_entry(w)[w.window_begin - lead : w.window_end]
                         for w in members])  # fmt: skip
        # Passes of one stack may enter a sample apart; before t1 there is nothing to see.
        entry = int(np.min(np.sum(time < 0, axis=-1)))
        stacks.append(
            PassStack(
                tuple(positions),
                np.stack([w.force[w.window_begin - lead : w.window_end] for w in members]),
                time,
                np.array([[rise_time(w)] for w in members]),
                np.array([w.belt_speed for w in members]),
                min(entry, lead),
                lead,
                min(block, lead + count + 1),
            )
        )
    return stacks


def stretch_length(min_length: int, count: int) -> int:
    """Return the length of the stretch for a window of `count` samples, a multiple of 128."""
    return _PERIOD * math.ceil(max(min_length, 2 * count) / _PERIOD)


def _extent(window: WeighWindow, min_length: int) -> tuple[int, int]:
    """Return how many samples before t2 are used, empty belt and rise, and the window's count."""
    begin, count = window.window_begin, window.window_end - window.window_begin
    room = (stretch_length(min_length, count) - count) // 2
    known = begin - min(max(window.empty_begin, 0), begin)
    return min(room, known) // _LEAD_STEP * _LEAD_STEP, count


def _block(window: WeighWindow) -> int:
    # No rate of a real load cell is above that of the limit.
    return max(1, round(min(window.sample_rate, MAX_SAMPLE_RATE) / PREDICTION_RATE))


def rise_time(window: WeighWindow) -> float:
    """Return t2 - t1 in s, 0 if it is not known."""
    if window.t1 is None or window.t2 is None:
        return 0.0
    return max(window.t2 - window.t1, 0) / NANOSECONDS


def time_since_entry(window: WeighWindow) -> NDArray[np.float64]:
    """Return the time of each sample since t1 in s.

    The first sample of the window lies within one sample after t2, whatever its stamp says.
    """
    begin, interval = window.window_begin, 1 / window.sample_rate
    after = begin * interval - ((window.t2 or 0) - window.stamp) / NANOSECONDS
    first = rise_time(window) + min(max(after, 0.0), interval)
    return first + (np.arange(len(window.counts), dtype=np.float64) - begin) * interval
