"""Cutting the blocks of a recording or a simulation anew, as its pace wants them.

How a stream is cut into blocks, and where between them its edges come, does not change what is
weighed. The stamp of a sample stays what
it was, but for rounding to a nanosecond.
"""

from collections.abc import Iterable, Iterator
import math
from typing import TypeVar

import numpy as np

from checkweigher_driver.recording import Event
from checkweigher_dsp.records import NANOSECONDS, Eye, EyeEdge, SampleBlock

LONGEST = 0.25  # s of signal in a joined block: the segmenter reports as often
_ROUNDING = 1  # ns

E = TypeVar('E', bound=Event)


def join(
    events: Iterable[E], sample_rate: float, longest: float = LONGEST
) -> Iterator[E | SampleBlock]:
    """Yield a stream with fewer, longer blocks.

    Parameters
    ----------
    events : iterable of Event
        In canonical order, which they keep.
    sample_rate : float
        Hz.
    longest : float
        s of signal, of a joined block; one that is longer already stays as it is.

    Yields
    ------
    Event
        Blocks that follow each other without a gap, in index and in time, as one.
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
        if blocks:
            yield _joined(blocks)
            blocks, count = [], 0
        yield event
    if blocks:
        yield _joined(blocks)


def join_past_edges(
    events: Iterable[Event], sample_rate: float, longest: float = LONGEST, *, prompt: bool
) -> Iterator[Event]:
    """Yield a stream with fewer blocks still: an edge comes before that in which it falls.

    Nobody waits for the samples at an edge but at t3, where the outfeed eye is blocked.

    Parameters
    ----------
    events : iterable of Event
        In canonical order: an edge follows the block in which it falls.
    sample_rate : float
        Hz.
    longest : float
        s of signal, of a joined block; one that is longer is cut at each edge.
    prompt : bool
        Whether a block ends at t3, so that the window does not wait for its end.

    Yields
    ------
    Event
        In the order in which they are due: a block when its last sample has been taken.
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
            before = math.ceil((event.stamp - blocks[0].stamp) * sample_rate / NANOSECONDS)
            is_exit = event.eye == Eye.OUTFEED and event.blocked
            if before >= count:
                yield _joined(blocks)
                blocks, count = [], 0
            elif before > 0 and ((prompt and is_exit) or count > longest * sample_rate):
                whole = _joined(blocks)
                yield _part(whole, 0, before, sample_rate)
                blocks, count = [_part(whole, before, count, sample_rate)], count - before
        yield event
    if blocks:
        yield _joined(blocks)


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
    longest = block_time if pace else LONGEST
    return join_past_edges(events, sample_rate, longest, prompt=pace > 0)


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
