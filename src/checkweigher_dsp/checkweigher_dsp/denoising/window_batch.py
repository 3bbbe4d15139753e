"""Stacks of passes: windows of equal shape as arrays, so that many can be computed at once."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.denoising.extrapolation import PREDICTION_RATE
from checkweigher_dsp.denoising.load_rise import load_share
from checkweigher_dsp.denoising.wavelet_shrinkage import LEVELS
from checkweigher_dsp.records import MAX_SAMPLE_RATE, NANOSECONDS, WeighWindow

_PERIOD = 2**LEVELS
# The signal before t2 is taken in steps of this, so that few shapes come about.
_LEAD_STEP = 16


@dataclass(frozen=True, slots=True)
class PassStack:
    """Passes of equal shape, to be denoised at once.

    One pass alone needs no axis for the passes: its arrays are (n,), the rest are floats. It is
    computed with the same bits, and faster than a stack of one.

    Attributes
    ----------
    positions : tuple of int
        Which of the windows these are.
    force : ndarray, (passes, n) or (n,) float64
        kg, from some empty belt before t1 up to t3.
    time : ndarray, (passes, n) or (n,) float64
        s since t1.
    rise_time : ndarray, (passes, 1) float64, or float
        s, t2 - t1.
    belt_speed : ndarray, (passes,) float64, or float
        m/s.
    entry, begin : int
        Columns of the first sample at or after t1, and at or after t2.
    block : int
        Samples in one block of the prediction.
    """

    positions: tuple[int, ...]
    force: NDArray[np.float64]
    time: NDArray[np.float64]
    rise_time: Any
    belt_speed: Any
    entry: int
    begin: int
    block: int

    @property
    def share(self) -> NDArray[np.float64]:
        """Share of the product on the belt at each sample, of the shape of `time`."""
        return load_share(self.time, self.rise_time)


def lone_pass(window: WeighWindow, min_length: int) -> PassStack:
    """Return the pass of one consistent window, see `stack_passes`."""
    lead, count = _extent(window, min_length)
    begin, end = window.window_begin - lead, window.window_end
    time = time_since_entry(window, begin, end)
    # Before t1 there is nothing to see.
    entry = min(int(time.searchsorted(0.0)), lead)
    return PassStack(
        (0,), window.force_between(begin, end), time, rise_time(window), window.belt_speed,
        entry, lead, min(_block(window), lead + count + 1),
    )  # fmt: skip


def stack_passes(
    windows: Sequence[WeighWindow],
    min_length: int,
    *,
    same_entry: bool = False,
    most: int | None = None,
) -> list[PassStack]:
    """Sort windows by shape into stacks.

    Parameters
    ----------
    windows : sequence of WeighWindow
        Consistent ones.
    min_length : int
        Of the stretch: half of it, at most, is taken from before t2.
    same_entry : bool
        Whether only passes come into one stack that enter at the same sample; otherwise they may
        be a few apart, and less of each is seen before t1 alone than among others.
    most : int, optional
        Passes in one stack.
    """
    shapes: dict[tuple[int, ...], list[int]] = {}
    passes = [lone_pass(window, min_length) for window in windows]
    for position, alone in enumerate(passes):
        shape: tuple[int, ...] = (alone.begin, len(alone.time), alone.block)
        if same_entry:
            shape = (*shape, alone.entry)
        shapes.setdefault(shape, []).append(position)
    stacks = []
    for positions in shapes.values():
        parts = math.ceil(len(positions) / (most or len(positions)))
        for part in range(parts):
            chosen = positions[part::parts]
            stacks.append(_stack([passes[position] for position in chosen], chosen))
    return stacks


def _stack(passes: Sequence[PassStack], positions: Sequence[int]) -> PassStack:
    first = passes[0]
    return PassStack(
        tuple(positions),
        np.array([alone.force for alone in passes]),
        np.array([alone.time for alone in passes]),
        np.array([[alone.rise_time] for alone in passes]),
        np.array([alone.belt_speed for alone in passes]),
        min(alone.entry for alone in passes),
        first.begin,
        first.block,
    )


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


def time_since_entry(
    window: WeighWindow, begin: int = 0, end: int | None = None
) -> NDArray[np.float64]:
    """Return the time since t1 in s of the samples from position `begin` up to `end`.

    The first sample of the window lies within one sample after t2, whatever its stamp says.
    """
    first, interval = window.window_begin, 1 / window.sample_rate
    after = first * interval - ((window.t2 or 0) - window.stamp) / NANOSECONDS
    since = rise_time(window) + min(max(after, 0.0), interval)
    end = len(window.counts) if end is None else end
    return since + np.arange(begin - first, end - first, dtype=np.float64) * interval
