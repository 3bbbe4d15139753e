"""The photo-eyes of a recording, on the samples of a real port."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import threading
from typing import ClassVar

from checkweigher_driver.sources import EdgeSource, EyesBack, EyesLost
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.records import NANOSECONDS, EyeEdge, SampleBlock
from checkweigher_recording.bags.reading import read_bag


@dataclass(frozen=True)
class ReplayedParameters(Parameters):
    """Whose edges."""

    node: ClassVar[str] = 'replayed'

    path: str = parameter('', 'folder of the bag whose edges are used, or its .mcap file')
    namespace: str = parameter(
        '', 'namespace of the lane, / for none; empty takes the only lane of the bag'
    )


class ReplayedEyes(EdgeSource):
    """Edges of a bag whose samples a device sends: to try a port without photo-eyes.

    Each edge hangs on the samples between which it was recorded, so that it falls between the same
    ones again. The device has to begin with the first sample of the bag.
    """

    parameters = ReplayedParameters

    def __init__(self, parameters: ReplayedParameters) -> None:
        if not parameters.path:
            raise ParameterError('replayed.path: empty, must name a bag')
        recording = read_bag(Path(parameters.path), parameters.namespace or None)
        rate, begin = recording.load_cell.sample_rate, recording.blocks[0].stamp
        self._period = NANOSECONDS / rate
        self._edges = [(edge, (edge.stamp - begin) / self._period) for edge in recording.edges]
        self._closed = threading.Event()

    def events(self) -> Iterator[EyeEdge | EyesLost | EyesBack]:
        """Yield nothing: all edges hang on samples."""
        self._closed.wait()
        yield from ()

    def follow(self, block: SampleBlock) -> list[EyeEdge]:
        """Return the edges before the end of a block."""
        found = []
        while self._edges and self._edges[0][1] < block.first_index + len(block.counts):
            edge, position = self._edges.pop(0)
            stamp = block.stamp + round((position - block.first_index) * self._period)
            found.append(EyeEdge(stamp, edge.eye, edge.blocked))
        return found

    def close(self) -> None:
        """Let `events` end."""
        self._closed.set()
