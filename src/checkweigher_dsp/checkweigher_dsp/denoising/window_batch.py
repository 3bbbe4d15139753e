# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches of weigh windows of equal shape, which are denoised together.

A single window is processed as a batch of one window. All operations work element by element or
along the last axis. So the result of a window is the same in any batch, to the last bit.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np

from checkweigher_core.records import MAX_SAMPLE_RATE, MAX_WINDOW, NANOSECONDS, WeighWindow, seconds
from checkweigher_dsp.denoising.extrapolation import PREDICTION_RATE
from checkweigher_dsp.denoising.load_rise import load_share
from checkweigher_dsp.denoising.wavelet_shrinkage import LEVELS
from checkweigher_dsp.signal import Array

_PERIOD = 2**LEVELS
# The number of used samples before t2 is a multiple of this number, so that windows have few
# different shapes.
_LEAD_STEP = 16
_SAMPLES_AT_ONCE = 2**20  # maximum number of samples of the padded windows of a batch


@dataclass(frozen=True, slots=True)
class WindowBatch:
    """Windows of equal shape, with the used samples before t2 and all samples from t2 to t3."""

    positions: tuple[int, ...]  # positions in the list of windows
    force: Array  # signal in kg, (windows, n)
    time: Array  # time since t1 in s, (windows, n)
    rise_time: Array  # t2 - t1 in s, (windows, 1)
    belt_speed: Array  # belt speed in m/s, (windows, 1)
    entry: int  # column of the first sample at or after t1
    begin: int  # column of the first sample at or after t2
    block: int  # number of samples in a block of the extrapolation

    @property
    def share(self) -> Array:
        """Fraction of the product on the belt at each sample, (windows, n)."""
        return load_share(self.time, self.rise_time)


def batches_of(windows: Sequence[WeighWindow], min_length: int) -> list[WindowBatch]:
    """Group consistent windows of equal shape into batches.

    A padded window has at least `min_length` samples, of which at most half are before t2.
    """
    times = [_used_time(window, min_length) for window in windows]
    shapes: dict[tuple[int, ...], list[int]] = {}
    for position, (window, (lead, time)) in enumerate(zip(windows, times, strict=True)):
        entry = min(int(time.searchsorted(0.0)), lead)
        block = round(min(window.sample_rate, MAX_SAMPLE_RATE) / PREDICTION_RATE)
        shape = entry, lead, min(max(1, block), len(time) + 1), len(time)
        shapes.setdefault(shape, []).append(position)
    batches = []
    for (entry, begin, block, count), positions in _in_parts(shapes, min_length):
        chosen = [windows[position] for position in positions]
        forces = [each.force_between(each.window_end - count, each.window_end) for each in chosen]
        batches.append(
            WindowBatch(
                tuple(positions),
                np.array(forces),
                time=np.array([times[position][1] for position in positions]),
                rise_time=np.array([[rise_time(each)] for each in chosen]),
                belt_speed=np.array([[each.belt_speed] for each in chosen]),
                entry=entry,
                begin=begin,
                block=block,
            )
        )
    return batches


def _in_parts(
    shapes: Mapping[tuple[int, ...], list[int]], min_length: int
) -> Iterator[tuple[tuple[int, ...], list[int]]]:
    """Yield each shape with the positions of its windows.

    A shape with many windows is yielded several times, each time with the positions of some of its
    windows, so that the size of a batch is limited.
    """
    for shape, positions in shapes.items():
        _, begin, _, count = shape
        most = max(1, _SAMPLES_AT_ONCE // padded_length(min_length, count - begin))
        for first in range(0, len(positions), most):
            yield shape, positions[first : first + most]


def padded_length(min_length: int, count: int) -> int:
    """Return the length to which a window of `count` samples is padded.

    The length is the smallest multiple of 128 that is at least `min_length` and at least twice
    `count`.
    """
    return _PERIOD * math.ceil(max(min_length, 2 * count) / _PERIOD)


def _used_time(window: WeighWindow, min_length: int) -> tuple[int, Array]:
    """Return the number of used samples before t2, and the times since t1 of all used samples in s.

    Samples before t2 are used if they are after the exit of the previous item and fit into the
    padding. The number of used samples before t2 is rounded down to a multiple of `_LEAD_STEP`.
    """
    begin, count = window.window_begin, window.window_end - window.window_begin
    room = (padded_length(min_length, count) - count) // 2
    known = begin - min(max(window.empty_begin, 0), begin)
    lead = min(room, known) // _LEAD_STEP * _LEAD_STEP
    return lead, time_since_entry(window, begin - lead, window.window_end)


def rise_time(window: WeighWindow) -> float:
    """Return the rise time t2 - t1 in s, or 0 if it is unknown or negative."""
    if window.t1 is None or window.t2 is None:
        return 0.0
    return max(window.t2 - window.t1, 0) / NANOSECONDS


def transit(window: WeighWindow) -> float:
    """Return the transit time t3 - t1 in s, or NaN if t1 or t3 is unknown."""
    if window.t1 is None or window.t3 is None:
        return math.nan
    return seconds(window.t3 - window.t1)


def time_since_entry(window: WeighWindow, begin: int = 0, end: int | None = None) -> Array:
    """Return the time since t1 in s of the samples with positions in [begin, end).

    If `end` is None, all samples from position `begin` on are included. The sample at
    ``window_begin`` is assumed to be within one sampling interval after t2, even if the stamp of
    the window is wrong.
    """
    first, interval = window.window_begin, 1 / window.sample_rate
    after = first * interval - ((window.t2 or 0) - window.stamp) / NANOSECONDS
    since = rise_time(window) + min(max(after, 0.0), interval)
    end = len(window.counts) if end is None else end
    return since + np.arange(begin - first, end - first, dtype=np.float64) * interval


def denoised_pass(window: WeighWindow) -> tuple[Array, Array]:
    """Return the denoised signal of a window in kg and the fraction of the product on the belt.

    Both arrays, (n,), extend from the first denoised sample to the last sample before t3. The
    fraction is 1 after t2.
    """
    begin, end = window.window_begin, window.window_end
    missing = int(np.count_nonzero(np.isnan(window.denoised[:begin])))
    share = np.ones(end - missing)
    share[: begin - missing] = load_share(
        time_since_entry(window, missing, begin), rise_time(window)
    )
    return window.denoised[missing:end], share


def is_consistent(window: WeighWindow) -> bool:
    """Return whether the fields of a window without reasons are consistent.

    There must be at most `MAX_WINDOW` samples, and at least one of them from t2 to t3. The sample
    rate and the belt speed must be positive and finite. The zeros, the standard deviation of the
    zero and the sensitivity must be finite, and the sensitivity must not be 0.
    """
    numbers = window.zero, window.zero_counts, window.zero_std_dev, window.counts_per_kg
    return (
        0 <= window.window_begin < window.window_end <= len(window.counts) <= MAX_WINDOW
        and 0 < window.sample_rate < math.inf
        and 0 < window.belt_speed < math.inf
        and all(map(math.isfinite, numbers))
        and window.counts_per_kg != 0
    )
