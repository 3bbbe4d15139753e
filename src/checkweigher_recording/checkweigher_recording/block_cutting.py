"""Cutting the blocks of a recording or a simulation anew, as its pace wants them.

How a stream is cut into blocks, and where between them its edges come, does not change what is
weighed. The stamp of a sample stays what it was, but for rounding to a nanosecond.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.records import NANOSECONDS, Eye, EyeEdge, SampleBlock
from checkweigher_recording.bags.block_columns import BlockColumns
from checkweigher_recording.recording import Event, Recording

LONGEST = 0.25  # s of signal in a joined block: the segmenter reports as often
_ROUNDING = 1  # ns
_NEARLY = 1e-3  # samples, more than the rounding of stamps


def join(
    events: Iterable[Event],
    sample_rate: float,
    longest: float = LONGEST,
    *,
    ends_block: Callable[[EyeEdge], bool],
) -> Iterator[Event]:
    """Yield a stream with fewer, longer blocks: an edge comes before that in which it falls.

    Parameters
    ----------
    events : iterable of Event
        In canonical order: an edge follows the block in which it falls.
    sample_rate : float
        Hz.
    longest : float
        s of signal, of a joined block; one that is longer is cut at each edge.
    ends_block : callable
        Tells of an edge whether a block is to end there, and to come before it.

    Yields
    ------
    Event
        In the order in which they are due, a block when its last sample has been taken. Blocks that
        follow each other without a gap, in index and in time, are one.
    """
    blocks: list[SampleBlock] = []
    count = 0
    for event in events:
        if isinstance(event, SampleBlock):
            if blocks and not _continues(blocks[0], count, event, sample_rate, longest):
                yield _joined(blocks)
                blocks, count = [], 0
            blocks.append(event)
            count += len(event.counts)
            continue
        if blocks and isinstance(event, EyeEdge):
            place = _place(event.stamp - blocks[0].stamp, sample_rate)
            before = math.ceil(place)
            wanted = ends_block(event) or count > longest * sample_rate
            if place > count + _NEARLY or (wanted and before >= count):
                yield _joined(blocks)
                blocks, count = [], 0
            elif wanted and before > 0:
                whole = _joined(blocks)
                yield _part(whole, 0, before, sample_rate)
                blocks, count = [_part(whole, before, count, sample_rate)], count - before
        yield event
    if blocks:
        yield _joined(blocks)


class JoinedSignal:
    """Samples and edges of a recording as `join` yields them if no edge ends a block, but faster.

    Only blocks that were longer before stay whole, with the edges that fall into them behind.

    Parameters
    ----------
    recording : Recording
        Its references are left out.
    longest : float
        s of signal, of a joined block.
    """

    def __init__(self, recording: Recording, longest: float = LONGEST) -> None:
        self._edges = recording.edges
        self._blocks = blocks = BlockColumns.of(recording.blocks)
        rate = recording.load_cell.sample_rate
        self._runs = runs = _runs(blocks, rate, longest)
        self._begins = blocks.begins[runs]
        self._ends = np.append(self._begins, len(blocks.counts))[1:]
        stamps = np.array([edge.stamp for edge in self._edges], np.int64)
        # An edge comes before the block of its stamp, so it falls into the run of the one before.
        last = np.searchsorted(blocks.stamps, stamps) - 1
        self._places = places = np.searchsorted(runs, last, 'right') - 1
        fallen = places >= 0
        run = places[fallen]
        count = (self._ends - self._begins)[run]
        place = _place(stamps[fallen] - blocks.stamps[runs][run], rate)
        places[fallen] += (place > count + _NEARLY) | (count > longest * rate)
        places[~fallen] = 0

    def __len__(self) -> int:
        """Return the number of joined blocks and edges."""
        return len(self._runs) + len(self._edges)

    def __iter__(self) -> Iterator[SampleBlock | EyeEdge]:
        """Yield them in the order in which they are due."""
        blocks, edges, places = self._blocks, self._edges, self._places.tolist()
        stamps, first_indices = blocks.stamps[self._runs], blocks.first_indices[self._runs]
        columns = (stamps, first_indices, self._begins, self._ends)
        edge = 0
        for run, row in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
            stamp, first, begin, end = row
            while edge < len(edges) and places[edge] <= run:
                yield edges[edge]
                edge += 1
            yield SampleBlock(stamp, first, blocks.counts[begin:end])
        yield from edges[edge:]


def _runs(blocks: BlockColumns, sample_rate: float, longest: float) -> NDArray[np.intp]:
    """Return the numbers of the blocks that do not continue the one before.

    Parameters
    ----------
    blocks : BlockColumns
        In canonical order.
    sample_rate, longest : float
        Hz, and s of signal that are joined at most.
    """
    if not blocks:
        return np.zeros(0, np.intp)
    first, lengths = blocks.first_indices, blocks.lengths
    apart = np.ones(len(blocks), bool)
    # A difference of unsigned numbers may have gone around.
    apart[1:] = (first[1:] < first[:-1]) | (np.diff(first) != lengths[:-1].astype(np.uint64))
    begins = blocks.begins
    ends, limit = begins + lengths, longest * sample_rate
    runs = np.array(_full_runs(np.flatnonzero(apart), begins, ends, limit), np.intp)
    of_block = np.searchsorted(runs, np.arange(len(blocks)), 'right') - 1
    taken = (begins - begins[runs][of_block]) * NANOSECONDS / sample_rate
    expected = blocks.stamps[runs][of_block] + np.rint(taken).astype(np.int64)
    if np.all(np.abs(blocks.stamps - expected) <= _ROUNDING):
        return runs
    return np.array(_runs_by_stamp(blocks, apart, sample_rate, limit), np.intp)


def _full_runs(
    apart: NDArray[np.intp], begins: NDArray[np.int64], ends: NDArray[np.int64], limit: float
) -> list[int]:
    """Return where runs begin if the stamps of all blocks go with their indices."""
    runs: list[int] = []
    ends_listed, stops = ends.tolist(), [*apart[1:].tolist(), len(ends)]
    for begin, stop in zip(apart.tolist(), stops, strict=True):
        number = begin
        while number < stop:
            runs.append(number)
            last = int(begins[number]) + limit
            number = max(bisect_right(ends_listed, last, number, stop), number + 1)
    return runs


def _runs_by_stamp(
    blocks: BlockColumns, apart: NDArray[np.bool_], sample_rate: float, limit: float
) -> list[int]:
    """Return where runs begin, block for block."""
    begins = blocks.begins
    columns = (apart, blocks.stamps, begins, begins + blocks.lengths)
    runs: list[int] = []
    origin = since = 0
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for number, (is_apart, stamp, begin, end) in enumerate(rows):
        expected = since + round((begin - origin) * NANOSECONDS / sample_rate)
        if is_apart or end - origin > limit or abs(stamp - expected) > _ROUNDING:
            runs.append(number)
            origin, since = begin, stamp
    return runs


def is_exit(edge: EyeEdge) -> bool:
    """Tell whether an edge is t3: a window ends there, other edges wait for no samples."""
    return edge.eye == Eye.OUTFEED and edge.blocked


def cut_for_pace(
    events: Iterable[Event], sample_rate: float, pace: float, block_time: float
) -> Iterator[Event]:
    """Yield a recorded or simulated stream in the blocks that it is to be published in.

    Parameters
    ----------
    events : iterable of Event
        In canonical order.
    sample_rate : float
        Hz.
    pace : float
        Seconds of signal in a second; 0 is as fast as nothing is lost, in long blocks.
    block_time : float
        s of signal in a block at any other pace; no window waits for the end of one.
    """
    if pace == 0:
        return join(events, sample_rate, ends_block=lambda edge: False)
    return join(events, sample_rate, block_time, ends_block=is_exit)


def _place(time: Any, sample_rate: float) -> Any:
    """Return how many samples are taken in a time, ns."""
    return time * sample_rate / NANOSECONDS


def _part(block: SampleBlock, begin: int, end: int, sample_rate: float) -> SampleBlock:
    stamp = block.stamp + round(begin * NANOSECONDS / sample_rate)
    return SampleBlock(stamp, block.first_index + begin, block.counts[begin:end])


def _continues(
    first: SampleBlock, count: int, block: SampleBlock, sample_rate: float, longest: float
) -> bool:
    expected = first.stamp + round(count * NANOSECONDS / sample_rate)
    return (
        block.first_index == first.first_index + count
        and abs(block.stamp - expected) <= _ROUNDING
        and count + len(block.counts) <= longest * sample_rate
    )


def _joined(blocks: list[SampleBlock]) -> SampleBlock:
    if len(blocks) == 1:
        return blocks[0]
    counts = np.concatenate([block.counts for block in blocks])
    return SampleBlock(blocks[0].stamp, blocks[0].first_index, counts)
