# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Replay of a recorded line as a source, and of recorded photo-eyes beside a real load cell."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.recording import Event, Recording
from checkweigher_core.records import NANOSECONDS, EyeEdge, SampleBlock
from checkweigher_driver.sources import EdgeSource, EyeEvent, Source
from checkweigher_recording.bags.reading import read_bag


@dataclass(frozen=True)
class BagParameters(Parameters):
    """Parameters of a replayed bag."""

    node: ClassVar[str] = 'bag'

    path: str = parameter('', 'folder of the bag, or its .mcap file')
    namespace: str = parameter(
        '', 'namespace of the lane, / for none; empty for the only lane of the bag'
    )

    def read(self) -> Recording:
        """Return the recording of the lane `namespace` in the bag.

        Raises `ParameterError` if `path` is empty, and `BagError` if the bag cannot be used (see
        `read_bag`).
        """
        if not self.path:
            raise ParameterError(f'{self.node}.path: empty, must name a bag')
        return read_bag(Path(self.path), self.namespace or None)


class BagSource(Source):
    """Replayed bag.

    The constructor reads the whole bag, so that damage is detected before the first event is sent.
    """

    parameters = BagParameters
    paced = True

    def __init__(self, parameters: BagParameters) -> None:
        self._recording = parameters.read()
        self.load_cell = self._recording.load_cell
        self.start_stamp = next(iter(self._recording)).stamp

    def __iter__(self) -> Iterator[Event]:
        """Yield the events of the bag in canonical order."""
        return iter(self._recording)

    def close(self) -> None:
        """Do nothing, because the bag is closed already."""


@dataclass(frozen=True)
class ReplayedParameters(BagParameters):
    """Parameters of photo-eyes that are replayed from a bag."""

    node: ClassVar[str] = 'replayed'

    path: str = parameter('', 'folder of the bag whose edges are used, or its .mcap file')


class ReplayedEyes(EdgeSource):
    """Photo-eyes that replay the edges of a bag while a device sends the samples of the same bag.

    A load cell on a serial port can thus be tested without real photo-eyes. The stamp of each edge
    lies between the stamps of the same two samples as in the bag. The device must begin with the
    first sample of the bag.
    """

    parameters = ReplayedParameters

    def __init__(self, parameters: ReplayedParameters) -> None:
        recording = parameters.read()
        rate, begin = recording.load_cell.sample_rate, recording.blocks[0].stamp
        self._period = NANOSECONDS / rate
        self._edges = [(edge, (edge.stamp - begin) / self._period) for edge in recording.edges]
        super().__init__(parameters)

    def events(self) -> Iterator[EyeEvent]:
        """Yield nothing, and end after `close`, because `follow` returns all edges."""
        self._closing.wait()
        yield from ()

    def follow(self, block: SampleBlock) -> list[EyeEdge]:
        """Return the edges before the end of a block, except those that were returned before."""
        found = []
        while self._edges and self._edges[0][1] < block.first_index + len(block.counts):
            edge, position = self._edges.pop(0)
            stamp = block.stamp + round((position - block.first_index) * self._period)
            found.append(EyeEdge(stamp, edge.eye, edge.blocked))
        return found
