"""Where samples and photo-eye edges come from: one interface, one registry.

A further source is one module with a `Source` class in it and one line in `SOURCES`.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar, cast

from checkweigher_driver.recording import Event
from checkweigher_dsp.parameters import ParameterError, Parameters
from checkweigher_dsp.records import EyeEdge, LoadCell

# Name and class. A class is imported when it is asked for, so that a machine needs only what its
# own source needs.
SOURCES = {
    'simulator': 'checkweigher_driver.sources.simulator:SimulatorSource',
    'bag': 'checkweigher_driver.sources.bag:BagSource',
}


class Source(ABC):
    """The machine, or what stands in for it.

    Parameters
    ----------
    parameters : Parameters
        An instance of the class's own set.

    Raises
    ------
    ValueError
        If the source cannot be opened; the message is one line for a technician.

    Attributes
    ----------
    parameters : type of Parameters
        What the source can be told.
    paced : bool
        Whether the reader has to keep the pace of the stamps. A source of hardware is not paced:
        its iterator blocks until something happens.
    load_cell : LoadCell
        The cell that takes the samples.
    start_stamp : int
        ns, stamp of the stream's first event or of the moment when it was opened.
    """

    parameters: ClassVar[type[Parameters]]
    paced: ClassVar[bool]
    load_cell: LoadCell
    start_stamp: int

    @abstractmethod
    def __init__(self, parameters: Any) -> None: ...

    @abstractmethod
    def __iter__(self) -> Iterator[Event]:
        """Yield events in canonical order until the stream ends.

        An edge of a source of hardware may come a block late: it is known when it happens, but
        the block before it only when that is full.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of what is open; an iterator that blocks ends. May come from another thread."""


@dataclass(frozen=True, slots=True)
class EyesLost:
    """The eyes are not read any more since ``stamp``, ns; ``text`` says why."""

    stamp: int
    text: str


@dataclass(frozen=True, slots=True)
class EyesBack:
    """The eyes are read again from ``stamp`` on, ns; the state found then is no edge."""

    stamp: int


class EdgeSource(ABC):
    """Photo-eyes that are read beside the load cell.

    Parameters
    ----------
    parameters : Parameters
        An instance of the class's own set; its ``node`` names the source.

    Raises
    ------
    ValueError
        If the source cannot be opened; the message is one line for a technician.
    """

    parameters: ClassVar[type[Parameters]]

    @abstractmethod
    def __init__(self, parameters: Any) -> None: ...

    @abstractmethod
    def events(self) -> Iterator[EyeEdge | EyesLost | EyesBack]:
        """Yield what happens, blocking, until `close`."""

    @abstractmethod
    def close(self) -> None:
        """Let go of what is open; `events` ends soon. May come from another thread."""

    @property
    def trouble(self) -> str:
        """One line while something is wrong, else empty."""
        return ''

    def figures(self) -> dict[str, float]:
        """Return what /diagnostics shows."""
        return {}


def source_class(name: str) -> type[Source]:
    """Return the class of a source.

    Parameters
    ----------
    name : str
        One of `SOURCES`.

    Raises
    ------
    ParameterError
        If there is no such source.
    """
    if name not in SOURCES:
        raise ParameterError(f'source: {name!r} is not one of {", ".join(SOURCES)}')
    module, found = SOURCES[name].split(':')
    return cast(type[Source], getattr(import_module(module), found))
