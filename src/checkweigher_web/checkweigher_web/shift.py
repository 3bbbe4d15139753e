# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded shift: its items in memory, its samples in a file from which a view reads its part."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
import math
from tempfile import TemporaryFile
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import BlockColumns, Recording
from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    EyeEdge,
    SampleBlock,
    Statistics,
    WeighWindow,
)
from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.pipeline.line import LineParameters, Weighing, WeighingLine
from checkweigher_production.statistics import ProductionStatistics
from checkweigher_recording.block_cutting import join_recording
from checkweigher_validation.accuracy.results import ResultJoiner
from checkweigher_web.lane import (
    MAX_ITEMS,
    Item,
    Stretch,
    emptiest,
    needs_stretch,
    span_of,
    stretch_of,
)
from checkweigher_web.mass_series import MassSeries

_BELT = 20 * NANOSECONDS  # before an item, in which the empty belt is looked for
_AROUND = NANOSECONDS  # of a window, whose stamp is that of the eyes: its samples lie within


@dataclass(frozen=True, slots=True)
class _Cut:
    """A window without its samples, and how many it has."""

    window: WeighWindow
    count: int


class Shift:
    """The items of a recording, weighed once in a thread of their own, in the order of verdicts.

    Attributes
    ----------
    items : list of Item
        As far as it is weighed; without their signals.
    faults : list of int
        Places of the faults among the items.
    begin, end, weighed : int
        First and last stamp, and how far it is weighed, ns.
    """

    def __init__(self, recording: Recording, parameters: LineParameters) -> None:
        self.recording = replace(recording, blocks=_on_disk(recording.blocks))
        self.parameters = parameters
        self.items: list[Item] = []
        self.faults: list[int] = []
        self.begin = self.weighed = recording.blocks[0].stamp
        self.is_whole = False
        self._stamps = [edge.stamp for edge in recording.edges]
        self._blocks = BlockColumns.of(self.recording.blocks)
        self._cuts: list[_Cut | None] = []
        self._denoiser = Denoiser(parameters.denoise)
        self.end = int(self._blocks.stamps[-1])

    def index(self) -> None:
        """Weigh everything; views show what there is meanwhile."""
        recording = self.recording
        line = WeighingLine(recording.load_cell, self.parameters)
        joiner = ResultJoiner(recording.edges, recording.references)
        speed = math.nan
        for weighing in line.weigh_all(self._followed()):
            known = joiner.join(weighing.estimate, weighing.verdict)
            self._add(weighing, known.t4, known.reference, speed)
            if math.isfinite(weighing.estimate.belt_speed):
                speed = weighing.estimate.belt_speed
        self.is_whole = True

    def start(self) -> None:
        """Index in a thread."""
        threading.Thread(target=self.index, name='shift', daemon=True).start()

    @property
    def progress(self) -> float:
        """Share of the recording that is weighed, 0..1."""
        return 1.0 if self.is_whole else (self.weighed - self.begin) / (self.end - self.begin + 1)

    def _followed(self) -> Iterator[SampleBlock | EyeEdge]:
        for event in join_recording(self.recording):
            self.weighed = event.stamp
            yield event

    def _add(self, weighing: Weighing, t4: int | None, reference: float, speed: float) -> None:
        window, cut = weighing.window, None
        if window is not None and len(window.counts):
            cut = _Cut(replace(window, counts=np.zeros(0, np.int32)), len(window.counts))
        item = Item(weighing.verdict, weighing.estimate, None, None, t4, reference, speed)
        self._cuts.append(cut)
        if item.verdict.decision == Decision.FAULT:
            self.faults.append(len(self.items))
        self.items.append(item)  # the last of it: views read without a lock

    def with_signals(self, place: int) -> Item:
        """Return the item at a place with its window and, of a fault, the samples around it."""
        item, cut = self.items[place], self._cuts[place]
        window = None if cut is None else self._read(cut)
        stretch = None
        if needs_stretch(item, window):
            span = span_of(item, self.recording.load_cell)
            stretch = None if span is None else self.stretch(*span)
        return replace(item, window=window, stretch=stretch)

    def stretch(self, begin: int, end: int) -> Stretch | None:
        """Return the raw signal from `begin` to `end`, ns; None without a sample there."""
        blocks = self.blocks_between(begin, end)
        return stretch_of(self.recording.load_cell, blocks, self.edges(begin, end), begin, end)

    def empty_belt(self, stamp: int) -> NDArray[np.float64]:
        """Return the longest stretch without an item before `stamp`, ns: (n,) kg."""
        begin = stamp - _BELT
        blocks = self.blocks_between(begin, stamp)
        return emptiest(self.recording.load_cell, blocks, self.edges(begin, stamp))

    def edges(self, begin: int, end: int) -> tuple[EyeEdge, ...]:
        """Return the edges from `begin` to `end`, ns."""
        edges, stamps = self.recording.edges, self._stamps
        return edges[bisect_left(stamps, begin) : bisect_right(stamps, end)]

    def blocks_between(self, begin: int, end: int) -> tuple[SampleBlock, ...]:
        """Return the blocks with the samples from `begin` to `end`, ns, and few others."""
        stamps = self._blocks.stamps
        first = max(int(np.searchsorted(stamps, begin, 'right')) - 1, 0)
        return self._blocks[first : int(np.searchsorted(stamps, end, 'right'))]

    def _read(self, cut: _Cut) -> WeighWindow | None:
        window, rate = cut.window, self.recording.load_cell.sample_rate
        length = round(NANOSECONDS * cut.count / rate)
        blocks = self.blocks_between(window.stamp - _AROUND, window.stamp + length + _AROUND)
        if not blocks:
            return None
        index = np.concatenate([b.first_index + np.arange(len(b.counts)) for b in blocks])
        counts = np.concatenate([block.counts for block in blocks])
        inside = (window.first_index <= index) & (index < window.first_index + cut.count)
        if np.count_nonzero(inside) != cut.count:
            return None
        return self._denoiser.denoise(replace(window, counts=counts[inside]))


class Playback:
    """A shift as it looked when one of its items had come: what a page shows in place of a lane.

    Each viewer has one of its own.
    """

    stop = filler = None

    def __init__(self, shift: Shift, name: str) -> None:
        self.shift = shift
        self.name = name
        self.load_cell = shift.recording.load_cell
        self.place = 0  # of the item among all
        self._moves = 0

    @property
    def version(self) -> tuple[int, int]:
        """What changes where the views have to."""
        return self._moves, min(len(self.shift.items), self.place + 1)

    def go(self, place: int) -> None:
        """Show the item at a place, or at the nearest there is."""
        self.place = min(max(place, 0), max(len(self.shift.items) - 1, 0))
        self._moves += 1

    def next_fault(self, *, forward: bool) -> int | None:
        """Return the place of the next fault, or of the one before; None without one."""
        faults = self.shift.faults
        at = bisect_right(faults, self.place) if forward else bisect_left(faults, self.place) - 1
        return faults[at] if 0 <= at < len(faults) else None

    def items(self) -> list[Item]:
        """Return the items until now without their signals, the latest first."""
        end = self.place + 1
        return self.shift.items[max(0, end - MAX_ITEMS) : end][::-1]

    def faults(self) -> list[Item]:
        """Return the faults until now, the latest first."""
        found = self.shift.faults[: bisect_right(self.shift.faults, self.place)]
        return [self.shift.items[place] for place in found[-MAX_ITEMS:]][::-1]

    def with_signals(self, item: Item) -> Item:
        """Return an item with its signals."""
        items = self.shift.items
        for place in range(min(self.place, len(items) - 1), -1, -1):
            if items[place] is item:
                return self.shift.with_signals(place)
        return item

    @property
    def statistics(self) -> Statistics:
        """Counts of the shift until now."""
        counts = ProductionStatistics()
        for item in self.shift.items[: self.place + 1]:
            counts.add(item.verdict)
        return counts.summary()

    @property
    def series(self) -> MassSeries:
        """Masses of the shift until now."""
        found = MassSeries()
        for item in self.shift.items[: self.place + 1]:
            found = found.with_item(item.verdict)
        return found

    def empty_belt(self) -> NDArray[np.float64]:
        """Return the longest stretch without an item before this one, (n,) kg."""
        items = self.shift.items
        if not items:
            return np.zeros(0)
        verdict = items[min(self.place, len(items) - 1)].verdict
        stamp = verdict.t3 or verdict.t1
        return np.zeros(0) if stamp is None else self.shift.empty_belt(stamp)


def _on_disk(blocks: Sequence[SampleBlock]) -> BlockColumns:
    """Return blocks whose columns lie in files without a name, which end with this process."""
    columns = BlockColumns.of(blocks)
    return BlockColumns(*(_on_disk_column(getattr(columns, f.name)) for f in fields(columns)))


def _on_disk_column(column: NDArray[Any]) -> NDArray[Any]:
    with TemporaryFile(prefix='checkweigher-') as file:
        column.tofile(file)
        file.flush()
        return np.memmap(file, column.dtype, 'r', shape=column.shape)
