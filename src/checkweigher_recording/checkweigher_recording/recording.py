"""What a machine sends, as one stream in the order of the stamps."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
import heapq

from checkweigher_dsp.records import EyeEdge, LoadCell, Reference, SampleBlock

Event = SampleBlock | EyeEdge | Reference


def canonical_order(event: Event) -> tuple[float, ...]:
    """Return the key that sorts events: by stamp, at equal stamps edge, reference, samples.

    A block counts with the stamp of its first sample, so the edges that fell while it was being
    sampled follow it. No two different events of one machine have the same key, so a sorted
    stream does not depend on the order in which its events were received.
    """
    if isinstance(event, EyeEdge):
        return event.stamp, 0, event.eye, event.blocked
    if isinstance(event, Reference):
        return event.stamp, 1, event.mass
    return event.stamp, 2, event.first_index


@dataclass(frozen=True, slots=True)
class Recording:
    """A finished stretch of line.

    Iterating gives every event in canonical order.

    Attributes
    ----------
    load_cell : LoadCell
        The cell that took the samples.
    blocks : sequence of SampleBlock
        In order of their stamps.
    edges : tuple of EyeEdge
        In order of their stamps.
    references : tuple of Reference
        In order of their stamps; empty if the masses are not known.
    unfinished : str
        How far it was read if it is the beginning of a recording that broke off, in one line;
        empty if it is whole.
    """

    load_cell: LoadCell
    blocks: Sequence[SampleBlock]
    edges: tuple[EyeEdge, ...]
    references: tuple[Reference, ...] = ()
    unfinished: str = ''

    @classmethod
    def from_events(cls, load_cell: LoadCell, events: Iterable[Event]) -> 'Recording':
        """Collect events that come in any order."""
        blocks: list[SampleBlock] = []
        edges: list[EyeEdge] = []
        references: list[Reference] = []
        for event in events:
            if isinstance(event, SampleBlock):
                blocks.append(event)
            elif isinstance(event, EyeEdge):
                edges.append(event)
            else:
                references.append(event)
        return cls(
            load_cell,
            tuple(sorted(blocks, key=canonical_order)),
            tuple(sorted(edges, key=canonical_order)),
            tuple(sorted(references, key=canonical_order)),
        )

    def __iter__(self) -> Iterator[Event]:
        """Yield the events in canonical order."""
        streams: tuple[Iterable[Event], ...] = (self.edges, self.references, self.blocks)
        return heapq.merge(*streams, key=canonical_order)
