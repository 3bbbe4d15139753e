# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Simulated line as a source."""

from collections.abc import Iterator
from dataclasses import dataclass
import os
import signal
from threading import Timer
import time

from checkweigher_core.parameters import parameter
from checkweigher_core.recording import Event
from checkweigher_core.records import NANOSECONDS
from checkweigher_driver.sources import Source
from checkweigher_recording.simulation.operation import OperationParameters
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters

# Time in s from the request to kill the driver to its end, so that the driver can answer the
# request.
_LAST_WORDS = 0.5


@dataclass(frozen=True)
class LiveSimulationParameters(SimulationParameters):
    """Parameters of the simulated machine, belt and products, and the time of the first sample."""

    start_time: int = parameter(
        0,
        'Unix time of the first sample; 0: the present time',
        unit='s',
        minimum=0,
        maximum=2_000_000_000,
    )


class SimulatorSource(Source):
    """Simulated line.

    The stamps of each stream begin at least 1 s after the stamp of the last event of the previous
    stream.
    """

    parameters = LiveSimulationParameters
    operation = OperationParameters
    paced = True

    def __init__(self, parameters: SimulationParameters) -> None:
        self._simulation = Simulation(parameters)
        self._simulation.start = self._start
        self._now = parameters.start_time == 0
        self.load_cell = self._simulation.load_cell
        self.start_stamp = parameters.start_time * NANOSECONDS or time.time_ns()

    def __iter__(self) -> Iterator[Event]:
        """Yield the events of the line in canonical order."""
        for event in self._simulation:
            self.start_stamp = event.stamp + NANOSECONDS  # earliest start of the next stream in ns
            yield event

    def _start(self) -> int:
        return max(self.start_stamp, time.time_ns()) if self._now else self.start_stamp

    def operate(self, operation: OperationParameters) -> None:
        """Apply the operator's settings.

        If the setting ``kill`` is true, the process of the driver is killed after 0.5 s.
        """
        self._simulation.operation = operation
        if operation.kill:
            Timer(_LAST_WORDS, os.kill, (os.getpid(), signal.SIGKILL)).start()

    def close(self) -> None:
        """Do nothing, because a simulation has no device."""
