# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorded shift, with the items in memory and the samples in files."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
import math
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
from checkweigher_web.history import History, history_of
from checkweigher_web.lane import ShownItem, Span, is_within, joined, with_window
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.raw_signal import RawSignal

# Duration in ns of the signal before an item in which a segment of the empty belt is searched for.
_BELT = 20 * NANOSECONDS
_AROUND = NANOSECONDS  # margin in ns around a window, because its stamp is not exact

_Cut = tuple[WeighWindow, int]  # window without its samples, and the number of samples


class Shift:
    """Items of a recording, which the page shows like the items of a running lane.

    A thread weighs the recording once.

    Attributes
    ----------
    name : str
        Name of the recording.
    series : MassSeries
        Masses of the items that were weighed so far.
    signal : RawSignal
        Samples, which are in files, and edges.
    begin, end, weighed : int
        Stamps in ns of the first sample, of the last block, and of the latest weighed event.
    """

    stop = filler = None
    alarms: tuple[Alarm, ...] = ()
    over: tuple[Alarm, ...] = ()
    judged = math.nan  # NaN, because the page shows no age for recorded items

    def __init__(self, recording: Recording, parameters: LineParameters, name: str = '') -> None:
        self.name = name
        self.load_cell = recording.load_cell
        blocks = _on_disk(recording.blocks)
        self.recording = replace(recording, blocks=blocks)
        self.signal = RawSignal(recording.load_cell, blocks, recording.edges)
        self.parameters = parameters
        self.series = MassSeries()
        self._items: list[ShownItem] = []  # items in the order of their verdicts
        self._counts = ProductionStatistics()
        self.begin = self.weighed = recording.blocks[0].stamp
        self.is_whole = False
        self._cuts: list[_Cut | None] = []
        self._denoiser = Denoiser(parameters.denoise)
        self.end = int(blocks.stamps[-1])

    def index(self) -> None:
        """Weigh the recording. The views show each item as soon as it is weighed."""
        joiner = ResultJoiner(self.recording.edges, self.recording.references)
        for item in joined(self._results(), joiner):
            self._counts.add(item.verdict)
            self.series = self.series.with_item(item.verdict)
            # Append the item last. The views read without a lock, and use the number of items as
            # the version of the data.
            self._items.append(item)
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
        """Fraction of the recording that is weighed, from 0 to 1."""
        return 1.0 if self.is_whole else (self.weighed - self.begin) / (self.end - self.begin + 1)

    def _followed(self) -> Iterator[SampleBlock | EyeEdge]:
        for event in join_recording(self.recording):
            self.weighed = event.stamp
            yield event

    @property
    def version(self) -> int:
        """Number of items that were weighed so far."""
        return len(self._items)

    @property
    def statistics(self) -> Statistics:
        """Production counts of the items that were weighed so far."""
        return self._counts.summary()

    def items(self, span: Span | None = None) -> list[ShownItem]:
        """Return the items, or only those in a span, without their signals, the latest first."""
        found = self._items[::-1]
        return found if span is None else [each for each in found if is_within(each.verdict, span)]

    def faults(self, span: Span | None = None) -> list[ShownItem]:
        """Return the items of `items(span)` with the decision FAULT, the latest item first."""
        return [each for each in self.items(span) if each.verdict.decision == Decision.FAULT]

    def history(self) -> History:
        """Return the items that were weighed so far, without belt noise or actions of users."""
        zeros = (math.nan if each.estimate is None else each.estimate.zero for each in self._items)
        verdicts = (each.verdict for each in self._items)
        return history_of(zip(verdicts, zeros, strict=False))

    def empty_belt(self, item: ShownItem | None = None) -> NDArray[np.float64]:
        """Return the signal of the longest segment with an empty belt, shape (n,), in kg.

        The mean of the signal is subtracted. The segment is within the 20 s before `item`. The
        array is empty if `item` is None, if the time of the item is not known, or if there are no
        samples.
        """
        stamp = None if item is None else item.verdict.time
        return np.zeros(0) if stamp is None else self.signal.empty_belt(stamp - _BELT, stamp)

    def with_signals(self, item: ShownItem) -> ShownItem:
        """Return an item with its denoised window and its raw samples, as `with_window` does."""
        cut = self._cuts[self._items.index(item)]
        window = None if cut is None else self._read(*cut)
        window = None if window is None else self._denoiser.denoise(window)
        return with_window(item, window, self.signal)

    def windows_before(self, item: ShownItem, count: int) -> list[WeighWindow]:
        """Return the windows of at most `count` items before an item.

        The latest window is the last one. Items without a window, and windows whose samples are
        missing, are left out.
        """
        place = self._items.index(item)
        cuts = [cut for cut in self._cuts[:place] if cut is not None][-count:]
        return [window for cut in cuts if (window := self._read(*cut)) is not None]

    def _read(self, window: WeighWindow, count: int) -> WeighWindow | None:
        """Return a window with its `count` samples, or None if samples are missing."""
        length = round(NANOSECONDS * count / self.recording.load_cell.sample_rate)
        blocks = self.signal.between(window.stamp - _AROUND, window.stamp + length + _AROUND)
        if not blocks:
            return None
        index = np.concatenate([b.first_index + np.arange(len(b.counts)) for b in blocks])
        counts = np.concatenate([block.counts for block in blocks])
        inside = (window.first_index <= index) & (index < window.first_index + count)
        if np.count_nonzero(inside) != count:
            return None
        return replace(window, counts=counts[inside])


def _on_disk(blocks: Sequence[SampleBlock]) -> BlockColumns:
    """Return blocks whose samples are in unnamed files, which are removed when the process ends."""
    columns = BlockColumns.of(blocks)
    return BlockColumns(*(_on_disk_column(getattr(columns, f.name)) for f in fields(columns)))


def _on_disk_column(column: NDArray[Any]) -> NDArray[Any]:
    with TemporaryFile(prefix='checkweigher-') as file:
        column.tofile(file)
        file.flush()
        return np.memmap(file, column.dtype, 'r', shape=column.shape)
