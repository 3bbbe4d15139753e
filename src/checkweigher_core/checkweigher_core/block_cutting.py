# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Division of a recorded or simulated signal into blocks of samples.

Long blocks are fast to process; short blocks arrive with little delay. The computed masses do not
depend on the lengths of the blocks. The time stamp of each sample is preserved to within 1 ns.
"""

from collections.abc import Callable, Iterable, Iterator
from heapq import merge
from itertools import chain
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import BlockColumns, Event, Recording
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, SampleBlock

LONGEST = 0.25  # default of the longest duration of a joined block in s
_ROUNDING = 1  # largest rounding error of a stamp in ns
_NEARLY = 1e-3  # tolerance of the position of an edge in samples, because stamps are rounded


def join(
    events: Iterable[Event],
    sample_rate: float,
    longest: float = LONGEST,
    *,
    ends_block: Callable[[EyeEdge], bool] = lambda edge: False,
) -> Iterator[Event]:
    """Yield the events, with consecutive blocks joined into longer blocks.

    Consecutive blocks are joined up to `longest` s of signal, unless there is a gap between them in
    the sample index or in time. An edge is yielded before the block that contains the time of the
    edge. However, if `ends_block` returns True for an edge, or the block is longer than `longest`,
    the block is cut at the edge. The samples before the cut are yielded before the edge. A
    reference mass is yielded at once, also before samples that are still being joined. If `events`
    are in the order of `recording.canonical_order`, blocks and edges are yielded in the order of a
    live source. A live source sends a block after the last sample of the block.
    """
    run = _Run(sample_rate, longest)
    for event in events:
        if isinstance(event, SampleBlock):
            if not run.goes_on_with(event):
                yield from run.take()
            run.add(event)
            continue
        if isinstance(event, EyeEdge):
            yield from run.take_before(event.stamp, ends_block=ends_block(event))
        yield event
    yield from run.take()


class _Run:
    """Consecutive blocks that will be joined into one block, called a run.

    `sample_rate` is in Hz. Blocks are joined up to a limit of `longest` s of samples.
    """

    def __init__(self, sample_rate: float, longest: float) -> None:
        self._sample_rate = sample_rate
        self._limit = longest * sample_rate
        self._blocks: list[SampleBlock] = []
        self._count = 0  # number of samples

    def add(self, block: SampleBlock) -> None:
        self._blocks.append(block)
        self._count += len(block.counts)

    def goes_on_with(self, block: SampleBlock) -> bool:
        """Return whether a block can be joined to the run.

        Any block can be joined to an empty run. A block can be joined to any other run if it
        follows the run without a gap, in the index and in time, and if the joined run is not longer
        than the limit.
        """
        if not self._blocks:
            return True
        first = self._blocks[0]
        expected = first.stamp + _duration(self._count, self._sample_rate)
        return (
            block.first_index == first.first_index + self._count
            and abs(block.stamp - expected) <= _ROUNDING
            and self._count + len(block.counts) <= self._limit
        )

    def take(self) -> Iterator[SampleBlock]:
        """Yield the samples of the run as one block, if there are any, and empty the run."""
        if self._blocks:
            yield self._joined()
        self._blocks, self._count = [], 0

    def take_before(self, stamp: int, *, ends_block: bool) -> Iterator[SampleBlock]:
        """Yield the samples before an edge, and remove them from the run.

        `stamp` is the time of the edge in ns. If the edge is within the run, no samples are
        yielded, unless `ends_block` is true or the run is longer than the limit.
        """
        if not self._blocks:
            return
        samples = (stamp - self._blocks[0].stamp) * self._sample_rate / NANOSECONDS
        before = math.ceil(samples)
        ends_block = ends_block or self._count > self._limit
        if samples > self._count + _NEARLY or (ends_block and before >= self._count):
            yield from self.take()
        elif ends_block and before > 0:
            whole = self._joined()
            yield SampleBlock(whole.stamp, whole.first_index, whole.counts[:before])
            stamp = whole.stamp + _duration(before, self._sample_rate)
            rest = SampleBlock(stamp, whole.first_index + before, whole.counts[before:])
            self._blocks, self._count = [rest], len(rest.counts)

    def _joined(self) -> SampleBlock:
        first, counts = self._blocks[0], [block.counts for block in self._blocks]
        return SampleBlock(first.stamp, first.first_index, np.concatenate(counts))


def join_recording(recording: Recording, longest: float = LONGEST) -> list[SampleBlock | EyeEdge]:
    """Return the blocks and edges of a recording, with fewer and longer blocks.

    This function is a fast version of `join` for a whole recording, without the argument
    `ends_block`. In contrast to `join`, this function does not cut a block that is longer than
    `longest` s, and returns the block before the edges that are within the block. Reference masses
    are omitted from the result.
    """
    rate = recording.load_cell.sample_rate
    blocks = BlockColumns.of(recording.blocks)
    starts = _starts(blocks, rate, longest)
    lengths = np.diff(blocks.begins[starts], append=len(blocks.counts))
    stamps, first_indices = blocks.stamps[starts], blocks.first_indices[starts]
    joined = BlockColumns(stamps, first_indices, lengths, blocks.counts)

    def due(event: SampleBlock | EyeEdge) -> int:
        if isinstance(event, EyeEdge) or len(event.counts) > longest * rate:
            return event.stamp
        return event.stamp + _duration(len(event.counts) + _NEARLY, rate)

    streams: tuple[Iterable[SampleBlock | EyeEdge], ...] = (recording.edges, joined)
    return list(merge(*streams, key=due))


def join_stretches(stretches: Iterable[Recording]) -> Iterator[SampleBlock | EyeEdge]:
    """Yield the joined blocks and the edges of consecutive parts of a recording.

    Blocks of different parts are not joined. Reference masses are omitted, as in `join_recording`.
    """
    return chain.from_iterable(map(join_recording, stretches))


def _starts(blocks: BlockColumns, sample_rate: float, longest: float) -> NDArray[np.intp]:
    """Return the position in `blocks` of the first block of each joined block, shape (m,)."""
    first, limit = blocks.first_indices, longest * sample_rate
    lost = np.ones(len(blocks), bool)
    # The first comparison detects an index that decreases. The difference might not show a
    # decrease, because a difference of unsigned integers wraps around instead of being negative.
    lost[1:] = (first[1:] < first[:-1]) | (np.diff(first) != blocks.lengths[:-1].astype(np.uint64))
    begins = blocks.begins
    columns = (lost, blocks.stamps, begins, begins + blocks.lengths)
    starts: list[int] = []
    origin = since = 0  # position in `counts` and stamp in ns of the first joined sample
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for number, (is_lost, stamp, begin, end) in enumerate(rows):
        expected = since + _duration(begin - origin, sample_rate)
        if is_lost or end - origin > limit or abs(stamp - expected) > _ROUNDING:
            starts.append(number)
            origin, since = begin, stamp
    return np.array(starts, np.intp)


def is_exit(edge: EyeEdge) -> bool:
    """Return whether an edge marks t3, the time at which a product reaches the outfeed eye."""
    return edge.eye == Eye.OUTFEED and edge.blocked


def cut_for_pace(
    events: Iterable[Event], sample_rate: float, pace: float, block_time: float
) -> Iterator[Event]:
    """Yield the events with blocks whose length suits the playback speed.

    `pace` is the playback speed in seconds of signal per second. If `pace` is 0, the signal is
    played as fast as possible, and blocks are joined up to `LONGEST` s. At any other speed, blocks
    are joined up to `block_time` s. A block also ends at each t3, because the weighing of the
    product can begin at t3.
    """
    if pace == 0:
        return join(events, sample_rate)
    return join(events, sample_rate, block_time, ends_block=is_exit)


def _duration(samples: float, sample_rate: float) -> int:
    return round(samples * NANOSECONDS / sample_rate)
