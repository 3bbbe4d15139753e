# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag as a machine: its samples and edges come at true time, with the stamps of now."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
import threading
import time
from typing import ClassVar

from checkweigher_core.parameters import Parameters, parameter
from checkweigher_core.recording import Event
from checkweigher_core.records import NANOSECONDS, Reference, SampleBlock
from checkweigher_driver.sources import Source
from checkweigher_recording.bags.reading import read_bag


@dataclass(frozen=True)
class LiveBagParameters(Parameters):
    node: ClassVar[str] = 'live'
    path: str = parameter('', 'bag')


class LiveBag(Source):
    parameters = LiveBagParameters
    paced = False

    def __init__(self, parameters: LiveBagParameters) -> None:
        self._recording = read_bag(Path(parameters.path))
        self._closing = threading.Event()
        self.load_cell = self._recording.load_cell
        self.start_stamp = time.time_ns()

    def __iter__(self) -> Iterator[Event]:
        shift = time.time_ns() - self._recording.blocks[0].stamp
        for event in self._recording:
            if isinstance(event, Reference):
                continue
            due = event.stamp + shift
            if isinstance(event, SampleBlock):
                due += round(len(event.counts) * NANOSECONDS / self.load_cell.sample_rate)
            if self._closing.wait(max(due - time.time_ns(), 0) / NANOSECONDS):
                return
            yield replace(event, stamp=event.stamp + shift)

    def close(self) -> None:
        self._closing.set()
