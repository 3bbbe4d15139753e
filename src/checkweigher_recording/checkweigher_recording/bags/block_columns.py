"""The blocks of a recording as columns: of many thousands each would cost more than its samples."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.records import SampleBlock


@dataclass(frozen=True, slots=True, eq=False)
class BlockColumns(Sequence[SampleBlock]):
    """A sequence of blocks, each of which is made when it is asked for.

    Attributes
    ----------
    stamps : ndarray, (n,) int64
        ns.
    first_indices : ndarray, (n,) uint64
        Index of the first sample of each block.
    lengths : ndarray, (n,) int64
        Samples in each block.
    counts : ndarray, (sum of lengths,) int32
        The samples of all blocks, one after the other.
    """

    stamps: NDArray[np.int64]
    first_indices: NDArray[np.uint64]
    lengths: NDArray[np.int64]
    counts: NDArray[np.int32]

    @property
    def begins(self) -> NDArray[np.int64]:
        """Position in `counts` of the first sample of each block."""
        return np.cumsum(self.lengths) - self.lengths

    @classmethod
    def of(cls, blocks: Sequence[SampleBlock]) -> 'BlockColumns':
        """Return blocks, in their order, as columns."""
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
        """Return the blocks of all parts, one part after the other."""
        return cls(
            np.concatenate([np.zeros(0, np.int64), *(part.stamps for part in parts)]),
            np.concatenate([np.zeros(0, np.uint64), *(part.first_indices for part in parts)]),
            np.concatenate([np.zeros(0, np.int64), *(part.lengths for part in parts)]),
            np.concatenate([np.zeros(0, np.int32), *(part.counts for part in parts)]),
        )

    def taken(self, order: NDArray[np.intp]) -> 'BlockColumns':
        """Return the blocks of these numbers in this order."""
        if np.array_equal(order, np.arange(len(self))):
            return self
        lengths = self.lengths[order]
        moved = self.begins[order] - (np.cumsum(lengths) - lengths)
        places = np.repeat(moved, lengths) + np.arange(np.sum(lengths))
        return BlockColumns(
            self.stamps[order], self.first_indices[order], lengths, self.counts[places]
        )

    def in_canonical_order(self) -> 'BlockColumns':
        """Return the blocks by stamp and first index; those of equal ones stay in their order."""
        return self.taken(np.lexsort((self.first_indices, self.stamps)))

    def __len__(self) -> int:
        """Return the number of blocks."""
        return len(self.stamps)

    def __iter__(self) -> Iterator[SampleBlock]:
        """Yield the blocks."""
        begins = self.begins
        columns = (self.stamps, self.first_indices, begins, begins + self.lengths)
        for stamp, first, begin, end in zip(*(column.tolist() for column in columns), strict=True):
            yield SampleBlock(stamp, first, self.counts[begin:end])

    @overload
    def __getitem__(self, number: int) -> SampleBlock: ...
    @overload
    def __getitem__(self, number: slice) -> tuple[SampleBlock, ...]: ...
    def __getitem__(self, number: int | slice) -> SampleBlock | tuple[SampleBlock, ...]:
        """Return a block, or several as a tuple."""
        if isinstance(number, slice):
            return tuple(self.taken(np.arange(len(self))[number]))
        begin = int(self.begins[number])
        return SampleBlock(
            int(self.stamps[number]),
            int(self.first_indices[number]),
            self.counts[begin : begin + int(self.lengths[number])],
        )
