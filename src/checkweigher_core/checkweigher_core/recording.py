# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a line: samples, photo-eye edges and reference masses, ordered by stamp."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
import heapq
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import EyeEdge, LoadCell, Reference, SampleBlock

Event = SampleBlock | EyeEdge | Reference

_AT_A_TIME = 1 << 14  # largest number of blocks processed at once


def canonical_order(event: Event) -> tuple[float, ...]:
    """Return the sort key of an event, which begins with its stamp.

    Of events with the same stamp, edges precede references, and references precede blocks. A block
    has the stamp of its first sample, so the edges during a block follow the block. Different
    events of a machine have different keys, so their order does not depend on the order of arrival.
    """
    if isinstance(event, EyeEdge):
        return event.stamp, 0, event.eye, event.blocked
    if isinstance(event, Reference):
        return event.stamp, 1, event.mass
    return event.stamp, 2, event.first_index


@dataclass(frozen=True, slots=True)
class Recording:
    """Blocks, edges and references of a line, each sorted by stamp."""

    load_cell: LoadCell
    blocks: Sequence[SampleBlock]
    edges: tuple[EyeEdge, ...]
    references: tuple[Reference, ...] = ()  # known masses of items; empty if no mass is known
    warning: str = ''  # one-line warning for the user, for example that the recording is incomplete

    @classmethod
    def from_events(cls, load_cell: LoadCell, events: Iterable[Event]) -> 'Recording':
        """Return a recording from events in any order."""
        ordered = sorted(events, key=canonical_order)
        return cls(
            load_cell,
            tuple(event for event in ordered if isinstance(event, SampleBlock)),
            tuple(event for event in ordered if isinstance(event, EyeEdge)),
            tuple(event for event in ordered if isinstance(event, Reference)),
        )

    def __iter__(self) -> Iterator[Event]:
        """Yield all events, sorted by `canonical_order`."""
        streams: tuple[Iterable[Event], ...] = (self.edges, self.references, self.blocks)
        return heapq.merge(*streams, key=canonical_order)


@dataclass(frozen=True, slots=True, eq=False)
class BlockColumns(Sequence[SampleBlock]):
    """Sequence of sample blocks, stored in arrays.

    A recording of one hour contains more than a hundred thousand blocks, and a `SampleBlock` object
    takes more memory than its samples. The objects are therefore created only on access.
    """

    stamps: NDArray[np.int64]  # stamp of each block in ns, shape (n,)
    first_indices: NDArray[np.uint64]  # index of the first sample of each block, shape (n,)
    lengths: NDArray[np.int64]  # number of samples in each block, shape (n,)
    counts: NDArray[np.int32]  # samples of all blocks, shape (sum of lengths,)

    @property
    def begins(self) -> NDArray[np.int64]:
        """Position in `counts` of the first sample of each block."""
        return np.cumsum(self.lengths) - self.lengths

    @classmethod
    def of(cls, blocks: Sequence[SampleBlock]) -> 'BlockColumns':
        """Return a `BlockColumns` object with the given blocks in the same order."""
        if isinstance(blocks, cls):
            return blocks
        counts = [block.counts for block in blocks]
        return cls(
            np.array([block.stamp for block in blocks], np.int64),
            np.array([block.first_index for block in blocks], np.uint64),
            np.array([len(block.counts) for block in blocks], np.int64),
            np.concatenate(counts) if counts else np.zeros(0, np.int32),
        )

    @classmethod
    def concatenate(cls, parts: Sequence['BlockColumns']) -> 'BlockColumns':
        """Return the blocks of one or more sequences, one after the other."""
        columns = ([getattr(part, each.name) for part in parts] for each in fields(cls))
        return cls(*map(np.concatenate, columns))

    def take(self, order: NDArray[np.intp]) -> 'BlockColumns':
        """Return the blocks at the positions `order`, in that order."""
        if np.array_equal(order, np.arange(len(self))):
            return self
        lengths = self.lengths[order]
        ends = np.cumsum(lengths)
        moved = self.begins[order] - (ends - lengths)
        counts = np.empty_like(self.counts, shape=int(np.sum(lengths)))
        for first in range(0, len(order), _AT_A_TIME):  # copy in parts to save memory
            some = slice(first, first + _AT_A_TIME)
            begin, end = int(ends[some][0] - lengths[some][0]), int(ends[some][-1])
            places = np.repeat(moved[some], lengths[some]) + np.arange(begin, end)
            counts[begin:end] = self.counts[places]
        return BlockColumns(self.stamps[order], self.first_indices[order], lengths, counts)

    def split(self, place: int) -> tuple['BlockColumns', 'BlockColumns']:
        """Return the blocks before a position and the remaining blocks, in separate arrays."""
        order = np.arange(len(self))
        return self.take(order[:place]), self.take(order[place:])

    def in_canonical_order(self) -> 'BlockColumns':
        """Return the blocks sorted by stamp and first index."""
        return self.take(np.lexsort((self.first_indices, self.stamps)))

    def __len__(self) -> int:
        """Return the number of blocks."""
        return len(self.stamps)

    def __iter__(self) -> Iterator[SampleBlock]:
        """Yield the blocks."""
        begins = self.begins
        columns = (self.stamps, self.first_indices, begins, begins + self.lengths)
        for number in range(0, len(self), _AT_A_TIME):  # convert in parts to save memory
            some = (column[number : number + _AT_A_TIME].tolist() for column in columns)
            for stamp, first, begin, end in zip(*some, strict=True):
                yield SampleBlock(stamp, first, self.counts[begin:end])

    def __getitem__(self, number: Any) -> Any:
        """Return one block, or a tuple of blocks for a slice."""
        if isinstance(number, slice):
            return tuple(self.take(np.arange(len(self))[number]))
        return next(iter(self.take(np.arange(len(self))[[number]])))
