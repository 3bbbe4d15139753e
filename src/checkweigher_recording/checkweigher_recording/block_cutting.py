# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Joining and cutting the blocks of a recording or a simulation to lengths that suit its pace.

How a stream is cut into blocks, and where between them its edges come, does not change what is
weighed. The stamp of a sample stays what it was, but for rounding to a nanosecond.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import BlockColumns, Event, Recording
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, SampleBlock

LONGEST = 0.25  # s of signal in a joined block: the segmenter reports as often
_ROUNDING = 1  # ns
_NEARLY = 1e-3  # samples, more than the rounding of stamps


def join(
    events: Iterable[Event], sample_rate: float, longest: float = LONGEST, *,
    ends_block: Callable[[EyeEdge], bool],
) -> Iterator[Event]:  # fmt: skip
    """Yield a stream with fewer, longer blocks: an edge comes before that in which it falls.

    Blocks that follow each other without a gap, in index and in time, become one of at most
    `longest` s of signal; a block that is longer is cut at each edge. Of events in canonical order,
    those that come out are in the order in which they are due, a block when its last sample has
    been taken. `ends_block` tells whether a block is to end at an edge, and to come before it.
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
    """Blocks that follow each other without a gap and are to become one."""

    def __init__(self, sample_rate: float, longest: float) -> None:
        self._sample_rate = sample_rate
        self._limit = longest * sample_rate
        self._blocks: list[SampleBlock] = []
        self._count = 0  # samples

    def add(self, block: SampleBlock) -> None:
        self._blocks.append(block)
        self._count += len(block.counts)

    def goes_on_with(self, block: SampleBlock) -> bool:
        """Tell whether a block follows without a gap and leaves the run short enough."""
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
        """Yield the run as one block, if there is any, and begin the next one."""
        if self._blocks:
            yield self._joined()
        self._blocks, self._count = [], 0

    def take_before(self, stamp: int, *, ends_block: bool) -> Iterator[SampleBlock]:
        """Yield what is to come before an edge: the run if the edge is behind it, or a part."""
        if not self._blocks:
            return
        samples = _samples(stamp - self._blocks[0].stamp, self._sample_rate)
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
    """Return samples and edges of a recording as `join` yields them if no edge ends a block.

    All at once, in a fraction of the time, and without references. Only blocks that were longer
    than `longest` s before stay whole, with the edges that fall into them behind.
    """
    rate, edges = recording.load_cell.sample_rate, recording.edges
    blocks = BlockColumns.of(recording.blocks)
    starts = _starts(blocks, rate, longest)
    begins = blocks.begins[starts]
    lengths = np.diff(begins, append=len(blocks.counts))
    joined = list(
        BlockColumns(blocks.stamps[starts], blocks.first_indices[starts], lengths, blocks.counts)
    )
    stamps = np.array([edge.stamp for edge in edges], np.int64)
    # An edge comes before the block of its stamp, so it falls into that of the one before, if any.
    before = np.searchsorted(blocks.stamps, stamps) - 1
    places = np.searchsorted(starts, before, 'right') - 1  # in `joined`, that each edge precedes
    falls = places >= 0
    into = places[falls]
    samples = _samples(stamps[falls] - blocks.stamps[starts][into], rate)
    is_behind = (samples > lengths[into] + _NEARLY) | (lengths[into] > longest * rate)
    places[falls] += is_behind
    places[~falls] = 0
    events: list[SampleBlock | EyeEdge] = []
    done = 0
    for edge, place in zip(edges, places.tolist(), strict=True):
        events += joined[done:place]
        done = max(done, place)
        events.append(edge)
    return events + joined[done:]


def join_stretches(
    stretches: Iterable[Recording], longest: float = LONGEST
) -> Iterator[SampleBlock | EyeEdge]:
    """Yield what `join_recording` returns of a recording that comes in stretches.

    Each stretch has the events, in canonical order, that follow those of the one before.
    """
    rest: Recording | None = None
    for stretch in stretches:
        whole = stretch if rest is None else _followed_by(rest, stretch)
        complete, rest = _before_last(whole, longest)
        yield from join_recording(complete, longest)
    if rest is not None:
        yield from join_recording(rest, longest)


def _followed_by(recording: Recording, other: Recording) -> Recording:
    """Return blocks and edges of a recording and of one after it."""
    parts = BlockColumns.of(recording.blocks), BlockColumns.of(other.blocks)
    edges = (*recording.edges, *other.edges)
    return replace(recording, blocks=BlockColumns.concatenate(parts), edges=edges)


def _before_last(recording: Recording, longest: float) -> tuple[Recording, Recording]:
    """Split a recording before its last joined block, which blocks to come may make longer."""
    blocks, edges = BlockColumns.of(recording.blocks), recording.edges
    starts = _starts(blocks, recording.load_cell.sample_rate, longest)
    if not len(starts):
        return replace(recording, edges=()), recording
    begin = blocks.stamps[starts[-1]]
    # An edge with the stamp of a block comes before it.
    place = bisect_right(edges, begin, key=lambda edge: edge.stamp)
    head, tail = blocks.split(int(starts[-1]))
    return (
        replace(recording, blocks=head, edges=edges[:place]),
        replace(recording, blocks=tail, edges=edges[place:]),
    )


def _starts(blocks: BlockColumns, sample_rate: float, longest: float) -> NDArray[np.intp]:
    """Return the numbers of the blocks, in canonical order, that begin a joined block."""
    first, limit = blocks.first_indices, longest * sample_rate
    lost = np.ones(len(blocks), bool)
    # A difference of unsigned numbers may have gone around.
    lost[1:] = (first[1:] < first[:-1]) | (np.diff(first) != blocks.lengths[:-1].astype(np.uint64))
    begins = blocks.begins
    columns = (lost, blocks.stamps, begins, begins + blocks.lengths)
    starts: list[int] = []
    origin = since = 0  # position and stamp of the first sample of the joined block
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for number, (is_lost, stamp, begin, end) in enumerate(rows):
        expected = since + _duration(begin - origin, sample_rate)
        if is_lost or end - origin > limit or abs(stamp - expected) > _ROUNDING:
            starts.append(number)
            origin, since = begin, stamp
    return np.array(starts, np.intp)


def is_exit(edge: EyeEdge) -> bool:
    """Tell whether an edge is t3: a window ends there, other edges wait for no samples."""
    return edge.eye == Eye.OUTFEED and edge.blocked


def cut_for_pace(
    events: Iterable[Event], sample_rate: float, pace: float, block_time: float
) -> Iterator[Event]:
    """Yield a recorded or simulated stream in the blocks that it is to be published in.

    `pace` is in seconds of signal in a second; 0 is as fast as nothing is lost, in long blocks. At
    any other pace a block holds `block_time` s of signal, and no window waits for the end of one.
    """
    if pace == 0:
        return join(events, sample_rate, ends_block=lambda edge: False)
    return join(events, sample_rate, block_time, ends_block=is_exit)


def _samples(time: Any, sample_rate: float) -> Any:
    """Return how many samples are taken in a time, ns; of a number or an array."""
    return time * sample_rate / NANOSECONDS


def _duration(samples: int, sample_rate: float) -> int:
    """Return how long some samples take, ns."""
    return round(samples * NANOSECONDS / sample_rate)
