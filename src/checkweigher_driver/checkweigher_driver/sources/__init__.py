# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sources of samples and photo-eye edges: the interface that all devices keep.

A load cell that knows nothing of the photo-eyes is joined with an `EdgeSource`.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

from checkweigher_core.parameters import Parameters
from checkweigher_core.recording import Event
from checkweigher_core.records import EyeEdge, LoadCell, SampleBlock


class Device(ABC):
    """The part of the interface that sources of samples and of edges share.

    `parameters` of the class is its parameter set. The constructor raises ValueError if the device
    cannot be opened; the message is one line for a technician.
    """

    parameters: ClassVar[type[Parameters]]

    @abstractmethod
    def __init__(self, parameters: Any) -> None: ...

    @abstractmethod
    def close(self) -> None:
        """Close what is open; a read that blocks ends soon. May come from another thread."""

    @property
    def trouble(self) -> str:
        """What is wrong at present, in one line; empty if all is well. For any thread."""
        return ''

    def figures(self) -> dict[str, float]:
        """Return what a technician wants to know, counted since the opening. For any thread."""
        return {}


class Source(Device):
    """A machine, a recording or a simulation."""

    # Whether the reader has to keep the pace of the stamps. A source of hardware is not paced: its
    # iterator blocks until something happens.
    paced: ClassVar[bool]
    # What an operator may set while it runs: of a simulated machine alone, which has no switches.
    operation: ClassVar[type[Parameters] | None] = None
    load_cell: LoadCell  # that takes the samples
    start_stamp: int  # ns, of the stream's first event or of the moment when it was opened

    @abstractmethod
    def __iter__(self) -> Iterator[Event]:
        """Yield events in canonical order until the stream ends.

        An edge of a source of hardware may come a block late: it is known when it happens, but
        the block before it only when that is full.
        """

    def operate(self, operation: Any) -> None:
        """Take what an operator sets, values of `operation`. May come from another thread."""


@dataclass(frozen=True, slots=True)
class EyesLost:
    """The eyes are not read any more; they last were at `stamp`, ns."""

    stamp: int
    text: str


@dataclass(frozen=True, slots=True)
class EyesBack:
    """The eyes are read again, from `stamp` on, ns. The state that they are found in is no edge."""

    stamp: int


EyeEvent = EyeEdge | EyesLost | EyesBack


class EdgeSource(Device):
    """Photo-eyes that are read beside the load cell."""

    @abstractmethod
    def events(self) -> Iterator[EyeEvent]:
        """Yield edges, stamped on the clock of the samples, as they come; block in between."""

    def follow(self, block: SampleBlock) -> list[EyeEdge]:
        """Return the edges that belong to a block, where they hang on the samples themselves."""
        return []
