# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded shift, with the items in memory and the samples in files."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from functools import reduce
from tempfile import TemporaryFile
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.block_cutting import join_recording
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
from checkweigher_validation.accuracy.results import ResultJoiner
from checkweigher_web.lane import MAX_ITEMS, ShownItem, joined, with_window
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.raw_signal import RawSignal

_BELT = 20 * NANOSECONDS  # time in ns before an item in which the empty belt is searched
_AROUND = NANOSECONDS  # margin in ns around a window, whose stamp is not exact

_Cut = tuple[WeighWindow, int]  # window without its samples, and the number of the samples


class Shift:
    """The items of a recording in the order of their verdicts. A thread weighs the recording once.

    Attributes
    ----------
    items : list of ShownItem
        Items that were weighed so far, without their signals.
    faults : list of int
        Indices of the faults in `items`.
    signal : RawSignal
        Samples, which are on disk, and edges.
    begin, end, weighed : int
        Stamps in ns of the first sample, of the last block, and of the latest weighed event.
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
        """Weigh the recording. The views already show the items that are weighed."""
        joiner = ResultJoiner(self.recording.edges, self.recording.references)
        for item in joined(self._results(), joiner):
            if item.verdict.decision == Decision.FAULT:
                self.faults.append(len(self.items))
            self.items.append(item)  # The views read without a lock, so this comes last.
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
        """Fraction of the recording that is weighed."""
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
        """Return a window with its samples after denoising, or None if samples are missing."""
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
    """A shift up to one of its items, which is shown like a lane. Each viewer has a playback."""

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
        """Set the index of the item. The index is limited to the range of the weighed items."""
        self.place = min(max(place, 0), max(len(self.shift.items) - 1, 0))
        self._moves += 1

    def next_fault(self, *, forward: bool) -> int | None:
        """Return the index of the next or the previous fault, or None if there is none."""
        faults = self.shift.faults
        at = bisect_right(faults, self.place) if forward else bisect_left(faults, self.place) - 1
        return faults[at] if 0 <= at < len(faults) else None

    def items(self) -> list[ShownItem]:
        """Return the items up to the present one without their signals, the latest item first."""
        end = self.place + 1
        return self.shift.items[max(0, end - MAX_ITEMS) : end][::-1]

    def faults(self) -> list[ShownItem]:
        """Return the faults up to the present item, the latest fault first."""
        found = self.shift.faults[: bisect_right(self.shift.faults, self.place)]
        return [self.shift.items[place] for place in found[-MAX_ITEMS:]][::-1]

    def with_signals(self, item: ShownItem) -> ShownItem:
        """Return an item with its signals."""
        return self.shift.with_signals(self.shift.items.index(item))

    @property
    def statistics(self) -> Statistics:
        """Production counts of the shift up to the present item."""
        counts = ProductionStatistics()
        for verdict in self._verdicts():
            counts.add(verdict)
        return counts.summary()

    @property
    def series(self) -> MassSeries:
        """Masses of the shift up to the present item."""
        return reduce(MassSeries.with_item, self._verdicts(), MassSeries())

    def _verdicts(self) -> Iterator[Verdict]:
        return (item.verdict for item in self.shift.items[: self.place + 1])

    def empty_belt(self) -> NDArray[np.float64]:
        """Return the longest part without an item before the present item, shape (n,), in kg."""
        latest = next(iter(self.items()), None)
        stamp = None if latest is None else latest.verdict.t3 or latest.verdict.t1
        if stamp is None:
            return np.zeros(0)
        return self.shift.signal.empty_belt(stamp - _BELT, stamp)


def _on_disk(blocks: Sequence[SampleBlock]) -> BlockColumns:
    """Return blocks in unnamed files, which the system removes when this process ends."""
    columns = BlockColumns.of(blocks)
    return BlockColumns(*(_on_disk_column(getattr(columns, f.name)) for f in fields(columns)))


def _on_disk_column(column: NDArray[Any]) -> NDArray[Any]:
    with TemporaryFile(prefix='checkweigher-') as file:
        column.tofile(file)
        file.flush()
        return np.memmap(file, column.dtype, 'r', shape=column.shape)
