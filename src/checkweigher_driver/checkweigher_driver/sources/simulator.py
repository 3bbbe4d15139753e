# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A simulated line as a source."""

from collections.abc import Iterator

from checkweigher_core.recording import Event
from checkweigher_core.records import NANOSECONDS
from checkweigher_driver.sources import Source
from checkweigher_recording.simulation.simulator import (
    OperationParameters,
    Simulation,
    SimulationParameters,
)


class SimulatorSource(Source):
    """A line that exists only in the computer; with ``count`` 0 it runs without end."""

    parameters = SimulationParameters
    operation = OperationParameters
    paced = True

    def __init__(self, parameters: SimulationParameters) -> None:
        self._simulation = Simulation(parameters)
        self.load_cell = self._simulation.load_cell
        self.start_stamp = parameters.start_time * NANOSECONDS

    def __iter__(self) -> Iterator[Event]:
        """Yield the line's events in canonical order."""
        return iter(self._simulation)

    def operate(self, operation: OperationParameters) -> None:
        """Apply settings of an operator."""
        self._simulation.operation = operation

    def close(self) -> None:
        """Do nothing: nothing is open."""
