# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sources of samples and photo-eye edges: the interface of all devices.

A load cell without photo-eyes is joined with an `EdgeSource`.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
import sys
import threading
from typing import Any, ClassVar

from checkweigher_core.parameters import Parameters
from checkweigher_core.recording import Event
from checkweigher_core.records import EyeEdge, LoadCell, SampleBlock

RETRY_TIME = 0.3  # s between attempts to reach a device
_SWITCH_INTERVAL = 0.0005  # s


def shorten_switch_interval() -> None:
    """Let the threads of this process take turns more often, at the cost of more switches.

    Threads that time photo-eyes or switch the rejector need this, because their wait for the
    interpreter adds to the uncertainty.
    """
    sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_INTERVAL))


class Device(ABC):
    """Common interface of the sources of samples and of edges.

    `parameters` of the class is its parameter set. The constructor raises ValueError if the device
    cannot be opened; the message is one line for a technician.
    """

    parameters: ClassVar[type[Parameters]]

    @abstractmethod
    def __init__(self, parameters: Any) -> None: ...

    @abstractmethod
    def close(self) -> None:
        """Close the device, from any thread; a blocking read then ends soon."""

    @property
    def trouble(self) -> str:
        """Present trouble in one line, empty if there is none. Any thread may read it."""
        return ''

    def figures(self) -> dict[str, float]:
        """Return figures for a technician, counted since the opening. Any thread may call it."""
        return {}


class Source(Device):
    """A machine, a recording or a simulation."""

    # Whether the reader has to keep the pace of the stamps. A source of hardware is not paced,
    # because its iterator blocks until there is an event.
    paced: ClassVar[bool]
    # Operator's settings during a run of a simulated machine, because it has no switches.
    operation: ClassVar[type[Parameters] | None] = None
    load_cell: LoadCell
    start_stamp: int  # ns, of the first event of the stream or of the opening

    @abstractmethod
    def __iter__(self) -> Iterator[Event]:
        """Yield events in canonical order until the stream ends.

        An edge of a source of hardware may come before the block of earlier samples, which is
        yielded when it is full.
        """

    def operate(self, operation: Any) -> None:
        """Apply the operator's settings, an instance of `operation`, from any thread."""


@dataclass(frozen=True, slots=True)
class EyesLost:
    """Loss of the eyes, which were last read at `stamp`, ns."""

    stamp: int
    text: str


@dataclass(frozen=True, slots=True)
class EyesBack:
    """Return of the eyes at `stamp`, ns. Their state at the return is not an edge."""

    stamp: int


EyeEvent = EyeEdge | EyesLost | EyesBack


class EdgeSource(Device):
    """Photo-eyes that are read beside the load cell."""

    def __init__(self, parameters: Any) -> None:
        self._closing = threading.Event()  # ends `events`

    def close(self) -> None:
        """Let `events` end soon."""
        self._closing.set()

    @abstractmethod
    def events(self) -> Iterator[EyeEvent]:
        """Yield edges as they come, stamped on the clock of the samples; block in between."""

    def follow(self, block: SampleBlock) -> list[EyeEdge]:
        """Return the edges that belong to a block, for eyes whose edges are tied to samples."""
        return []
