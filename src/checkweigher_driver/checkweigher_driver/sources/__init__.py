# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Interface of the sources of samples and of photo-eye edges."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
import sys
import threading
from typing import Any, ClassVar

from checkweigher_core.parameters import Parameters
from checkweigher_core.recording import Event
from checkweigher_core.records import EyeEdge, LoadCell, SampleBlock

RETRY_TIME = 0.3  # time in s between attempts to open a device
_SWITCH_INTERVAL = 0.0005  # longest thread switch interval of the interpreter in s


def shorten_switch_interval() -> None:
    """Shorten the thread switch interval of the interpreter to at most 0.5 ms.

    With the default interval, threads that time photo-eyes or switch the rejector would wait too
    long for the global interpreter lock.
    """
    sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_INTERVAL))


class Device(ABC):
    """Common interface of the sources of samples and of edges.

    `parameters` is the class of the parameter set. The constructor raises ValueError if the device
    cannot be opened; the message is one line for a technician.
    """

    parameters: ClassVar[type[Parameters]]

    @abstractmethod
    def __init__(self, parameters: Any) -> None: ...

    @abstractmethod
    def close(self) -> None:
        """Close the device, so that a blocking read ends soon. Any thread may call this."""

    @property
    def trouble(self) -> str:
        """Present fault of the device in one line, or an empty string if there is no fault.

        Any thread may read this property.
        """
        return ''

    def figures(self) -> dict[str, float]:
        """Return values for the diagnostics, by name. Any thread may call this."""
        return {}


class Source(Device):
    """Source of samples and edges: a machine, a recording or a simulation."""

    # Whether the caller has to wait until each event is due. The value is false for hardware, whose
    # iterator blocks until an event occurs.
    paced: ClassVar[bool]
    # Class of the settings that the operator of a simulated machine may change while the machine
    # runs, None for other sources.
    operation: ClassVar[type[Parameters] | None] = None
    load_cell: LoadCell
    # Stamp in ns of the start of the next stream: the stamp of the first event of a recording, the
    # time at which a device was opened, or the earliest start of a simulation.
    start_stamp: int

    @abstractmethod
    def __iter__(self) -> Iterator[Event]:
        """Yield events in canonical order until the stream ends.

        `checkweigher_core.recording.canonical_order` defines the canonical order. With hardware, an
        edge may be yielded before a block of earlier samples, because a block is yielded only when
        it is complete.
        """

    def operate(self, operation: Any) -> None:
        """Apply the operator's settings, an instance of `operation`. Any thread may call this."""


@dataclass(frozen=True, slots=True)
class EyesLost:
    """Loss of the photo-eyes after they were last read at `stamp` in ns. `text` is the reason."""

    stamp: int
    text: str


@dataclass(frozen=True, slots=True)
class EyesBack:
    """End of a loss of the photo-eyes, which are read again from the time `stamp` in ns on."""

    stamp: int


EyeEvent = EyeEdge | EyesLost | EyesBack


class EdgeSource(Device):
    """Photo-eyes that are connected separately from the load cell."""

    def __init__(self, parameters: Any) -> None:
        self._closing = threading.Event()  # ends `events`

    def close(self) -> None:
        """Request the end of the iterator `events`, which ends after its present wait or read."""
        self._closing.set()

    @abstractmethod
    def events(self) -> Iterator[EyeEvent]:
        """Yield edges, and the start and end of each loss of the eyes, until `close` is called.

        The stamps of edges and samples are on the same clock. Edges that `follow` returns are not
        yielded. An exception ends the source that uses the eyes.
        """

    def follow(self, block: SampleBlock) -> list[EyeEdge]:
        """Return the edges before the end of a block, if the edges were recorded with the samples.

        Eyes that are read in real time return no edges here, but yield them in `events`.
        """
        return []
