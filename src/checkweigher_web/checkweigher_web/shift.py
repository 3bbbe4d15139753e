# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded shift, with its items in memory and its samples in files."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from functools import reduce
from tempfile import TemporaryFile
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import BlockColumns, Recording
from checkweigher_core.records import (
    NANOSECONDS,
    Alarm,
    Decision,
    EyeEdge,
    MassEstimate,
    SampleBlock,
    Statistics,
    Verdict,
    WeighWindow,
)
from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_production.statistics import ProductionStatistics
from checkweigher_recording.block_cutting import join_recording
from checkweigher_validation.accuracy.results import ResultJoiner
from checkweigher_web.lane import MAX_ITEMS, ShownItem, joined, with_window
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.raw_signal import RawSignal

_BELT = 20 * NANOSECONDS  # ns before an item in which the empty belt is sought
_AROUND = NANOSECONDS  # ns around a window, because its samples may lag behind its stamp


_Cut = tuple[WeighWindow, int]  # a window without its samples, and their number


class Shift:
    """The items of a recording, weighed once in a thread, in the order of verdicts.

    Attributes
    ----------
    items : list of ShownItem
        Items so far, without signals.
    faults : list of int
        Indices of the faults.
    signal : RawSignal
        Samples on disk, and the edges.
    begin, end, weighed : int
        First and last stamp, and the stamp of the last weighed event, in ns.
    """

    def __init__(self, recording: Recording, parameters: LineParameters) -> None:
        blocks = _on_disk(recording.blocks)
        self.recording = replace(recording, blocks=blocks)
        self.signal = RawSignal(recording.load_cell, blocks, recording.edges)
        self.parameters = parameters
        self.items: list[ShownItem] = []
        self.faults: list[int] = []
        self.begin = self.weighed = recording.blocks[0].stamp
        self.is_whole = False
        self._cuts: list[_Cut | None] = []
        self._denoiser = Denoiser(parameters.denoise)
        self.end = int(blocks.stamps[-1])

    def index(self) -> None:
        """Weigh the recording; views show the items so far."""
        joiner = ResultJoiner(self.recording.edges, self.recording.references)
        for item in joined(self._results(), joiner):
            if item.verdict.decision == Decision.FAULT:
                self.faults.append(len(self.items))
            self.items.append(item)  # last, because views read without a lock
        self.is_whole = True

    def _results(self) -> Iterator[tuple[Verdict, MassEstimate]]:
        line = WeighingLine(self.recording.load_cell, self.parameters)
        for weighing in line.weigh_all(self._followed()):
            window, cut = weighing.window, None
            if window is not None and len(window.counts):
                cut = replace(window, counts=np.zeros(0, np.int32)), len(window.counts)
            self._cuts.append(cut)
            yield weighing.verdict, weighing.estimate

    def start(self) -> None:
        """Weigh the recording in a thread."""
        threading.Thread(target=self.index, name='shift', daemon=True).start()

    @property
    def progress(self) -> float:
        """Weighed fraction of the recording."""
        return 1.0 if self.is_whole else (self.weighed - self.begin) / (self.end - self.begin + 1)

    def _followed(self) -> Iterator[SampleBlock | EyeEdge]:
        for event in join_recording(self.recording):
            self.weighed = event.stamp
            yield event

    def with_signals(self, place: int) -> ShownItem:
        """Return the item at an index with its window, or a fault with the samples around it."""
        item, cut = self.items[place], self._cuts[place]
        window = None if cut is None else self._read(*cut)
        return with_window(item, window, self.signal)

    def _read(self, window: WeighWindow, count: int) -> WeighWindow | None:
        """Return a window with its samples, denoised; None if samples are missing."""
        length = round(NANOSECONDS * count / self.recording.load_cell.sample_rate)
        blocks = self.signal.between(window.stamp - _AROUND, window.stamp + length + _AROUND)
        if not blocks:
            return None
        index = np.concatenate([b.first_index + np.arange(len(b.counts)) for b in blocks])
        counts = np.concatenate([block.counts for block in blocks])
        inside = (window.first_index <= index) & (index < window.first_index + count)
        if np.count_nonzero(inside) != count:
            return None
        return self._denoiser.denoise(replace(window, counts=counts[inside]))


class Playback:
    """A shift up to one of its items, which a page shows in place of a lane.

    Each viewer has a playback of its own.
    """

    stop = filler = None
    alarms: tuple[Alarm, ...] = ()

    def __init__(self, shift: Shift, name: str) -> None:
        self.shift = shift
        self.name = name
        self.load_cell = shift.recording.load_cell
        self.place = 0  # index of the item
        self._moves = 0

    @property
    def version(self) -> tuple[int, int]:
        """Value that changes whenever the views must be updated."""
        return self._moves, min(len(self.shift.items), self.place + 1)

    def go(self, place: int) -> None:
        """Show the item at an index, or the nearest one."""
        self.place = min(max(place, 0), max(len(self.shift.items) - 1, 0))
        self._moves += 1

    def next_fault(self, *, forward: bool) -> int | None:
        """Return the index of the next or previous fault, or None."""
        faults = self.shift.faults
        at = bisect_right(faults, self.place) if forward else bisect_left(faults, self.place) - 1
        return faults[at] if 0 <= at < len(faults) else None

    def items(self) -> list[ShownItem]:
        """Return the items up to this one without their signals, the latest first."""
        end = self.place + 1
        return self.shift.items[max(0, end - MAX_ITEMS) : end][::-1]

    def faults(self) -> list[ShownItem]:
        """Return the faults up to this item, the latest first."""
        found = self.shift.faults[: bisect_right(self.shift.faults, self.place)]
        return [self.shift.items[place] for place in found[-MAX_ITEMS:]][::-1]

    def with_signals(self, item: ShownItem) -> ShownItem:
        """Return an item with its signals."""
        return self.shift.with_signals(self.shift.items.index(item))

    @property
    def statistics(self) -> Statistics:
        """Counts of the shift up to this item."""
        counts = ProductionStatistics()
        for verdict in self._verdicts():
            counts.add(verdict)
        return counts.summary()

    @property
    def series(self) -> MassSeries:
        """Masses of the shift up to this item."""
        return reduce(MassSeries.with_item, self._verdicts(), MassSeries())

    def _verdicts(self) -> Iterator[Verdict]:
        return (item.verdict for item in self.shift.items[: self.place + 1])

    def empty_belt(self) -> NDArray[np.float64]:
        """Return the longest part of the signal without an item before this one: (n,) in kg."""
        latest = next(iter(self.items()), None)
        stamp = None if latest is None else latest.verdict.t3 or latest.verdict.t1
        if stamp is None:
            return np.zeros(0)
        return self.shift.signal.empty_belt(stamp - _BELT, stamp)


def _on_disk(blocks: Sequence[SampleBlock]) -> BlockColumns:
    """Return blocks with their columns in unnamed files, which end with this process."""
    columns = BlockColumns.of(blocks)
    return BlockColumns(*(_on_disk_column(getattr(columns, f.name)) for f in fields(columns)))


def _on_disk_column(column: NDArray[Any]) -> NDArray[Any]:
    with TemporaryFile(prefix='checkweigher-') as file:
        column.tofile(file)
        file.flush()
        return np.memmap(file, column.dtype, 'r', shape=column.shape)
