"""Cutting the blocks of a recording or a simulation anew, as its pace wants them.

How a stream is cut into blocks does not change what is weighed. The stamp of a sample stays what
it was, but for rounding to a nanosecond.
"""

from collections.abc import Iterable, Iterator
import math
from typing import TypeVar

import numpy as np

from checkweigher_driver.recording import Event
from checkweigher_dsp.records import NANOSECONDS, EyeEdge, SampleBlock

LONGEST = 0.25  # s of signal in a joined block: the segmenter reports as often
_ROUNDING = 1  # ns

E = TypeVar('E', bound=Event)


def cut_at_edges(events: Iterable[Event], sample_rate: float) -> Iterator[Event]:
    """Yield a stream so that no edge waits for the end of the block in which it falls.

    Parameters
    ----------
    events : iterable of Event
        In canonical order: an edge follows the block in which it falls.
    sample_rate : float
        Hz.

    Yields
    ------
    Event
        The samples before an edge, the edge, the samples after it.
    """
    held: SampleBlock | None = None
    for event in events:
        if isinstance(event, EyeEdge) and held is not None:
            before = math.ceil((event.stamp - held.stamp) * sample_rate / NANOSECONDS)
            if 0 < before < len(held.counts):
                yield _part(held, 0, before, sample_rate)
                held = _part(held, before, len(held.counts), sample_rate)
            elif before > 0:
                yield held
                held = None
        elif isinstance(event, SampleBlock):
            if held is not None:
                yield held
            held = event
            continue
        yield event
    if held is not None:
        yield held


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


def cut_for_pace(
    events: Iterable[Event], sample_rate: float, pace: float, block_time: float
) -> Iterator[Event]:
    """Yield a recorded or simulated stream in the blocks that it is to be published in.

    Parameters
    ----------
    events : iterable of Event
        In canonical order, which they keep.
    sample_rate : float
        Hz.
    pace : float
        Seconds of signal in a second; 0 is as fast as nothing is lost, in long blocks.
    block_time : float
        s of signal in a block at any other pace; no edge waits for the end of one.
    """
    if pace == 0:
        return join(events, sample_rate)
    return cut_at_edges(join(events, sample_rate, block_time), sample_rate)


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
