"""Where samples and photo-eye edges come from: one interface, one registry.

A further source is one module with a `Source` class in it and one line in `SOURCES`. A load cell
that knows nothing of the photo-eyes is joined with an `EdgeSource` of `EYES`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar, cast

from checkweigher_dsp.parameters import ParameterError, Parameters
from checkweigher_dsp.records import EyeEdge, LoadCell, SampleBlock
from checkweigher_recording.recording import Event

# Name and class. A class is imported when it is asked for, so that a machine needs only what its
# own source needs.
SOURCES = {
    'simulator': 'checkweigher_driver.sources.simulator:SimulatorSource',
    'bag': 'checkweigher_driver.sources.bag:BagSource',
    'aed': 'checkweigher_driver.sources.aed:AedSource',
    'ascii': 'checkweigher_driver.sources.ascii:AsciiSource',
}
NO_EYES = 'none'
EYES = {
    NO_EYES: '',
    'replayed': 'checkweigher_driver.sources.replayed:ReplayedEyes',
    'modbus': 'checkweigher_driver.line_io.modbus:ModbusEyes',
    'gpio': 'checkweigher_driver.line_io.gpio:GpioEyes',
}


class Device(ABC):
    """What sources of samples and of edges have in common.

    Parameters
    ----------
    parameters : Parameters
        An instance of the class's own set.

    Raises
    ------
    ValueError
        If it cannot be opened; the message is one line for a technician.

    Attributes
    ----------
    parameters : type of Parameters
        What it can be told.
    """

    parameters: ClassVar[type[Parameters]]

    @abstractmethod
    def __init__(self, parameters: Any) -> None: ...

    @abstractmethod
    def close(self) -> None:
        """Let go of what is open; what blocks ends soon. May come from another thread."""

    @property
    def trouble(self) -> str:
        """What is wrong at present, in one line; empty if all is well. For any thread."""
        return ''

    def figures(self) -> dict[str, float]:
        """Return what a technician wants to know, counted since the opening. For any thread."""
        return {}


class Source(Device):
    """The machine, or what stands in for it.

    Attributes
    ----------
    paced : bool
        Whether the reader has to keep the pace of the stamps. A source of hardware is not paced:
        its iterator blocks until something happens.
    load_cell : LoadCell
        The cell that takes the samples.
    start_stamp : int
        ns, stamp of the stream's first event or of the moment when it was opened.
    """

    paced: ClassVar[bool]
    load_cell: LoadCell
    start_stamp: int

    @abstractmethod
    def __iter__(self) -> Iterator[Event]:
        """Yield events in canonical order until the stream ends.

        An edge of a source of hardware may come a block late: it is known when it happens, but
        the block before it only when that is full.
        """


@dataclass(frozen=True, slots=True)
class EyesLost:
    """The eyes are not read any more; they last were at `stamp`, ns."""

    stamp: int
    text: str


@dataclass(frozen=True, slots=True)
class EyesBack:
    """The eyes are read again, from `stamp` on, ns. The state that they are found in is no edge."""

    stamp: int


class EdgeSource(Device):
    """Photo-eyes that are read beside the load cell."""

    @abstractmethod
    def events(self) -> Iterator[EyeEdge | EyesLost | EyesBack]:
        """Yield edges, stamped on the clock of the samples, as they come; block in between."""

    def follow(self, block: SampleBlock) -> list[EyeEdge]:
        """Return the edges that belong to a block, where they hang on the samples themselves."""
        return []


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
    return cast(type[Source], _found(SOURCES[name]))


def eyes_class(name: str) -> type[EdgeSource]:
    """Return the class of photo-eyes that are read beside the load cell.

    Parameters
    ----------
    name : str
        One of `EYES` but 'none'.

    Raises
    ------
    ParameterError
        If there are no such eyes.
    """
    if not EYES.get(name):
        known = [eyes for eyes in EYES if eyes != NO_EYES]
        raise ParameterError(f'eyes: {name!r} is not one of {", ".join(known)}')
    return cast(type[EdgeSource], _found(EYES[name]))


def _found(place: str) -> Any:
    module, name = place.split(':')
    return getattr(import_module(module), name)


def source_maker(
    name: str, eyes: str, read: Callable[[type[Parameters]], Parameters]
) -> Callable[[], Source]:
    """Return what opens a source of samples, and with it the photo-eyes that are read beside it.

    Parameters
    ----------
    name : str
        One of `SOURCES`.
    eyes : str
        One of `EYES`; 'none' for a source that knows the eyes itself, or for no eyes.
    read : callable
        Returns the parameters of a class of them; called at once.

    Raises
    ------
    ParameterError
        If the two do not go together or a parameter cannot be used. What is returned raises
        ValueError if one of the two cannot be opened, in one line for a technician.
    """
    make_source = source_class(name)
    parameters = read(make_source.parameters)
    if eyes == NO_EYES:
        return lambda: make_source(parameters)
    make_eyes = eyes_class(eyes)
    if make_source.paced:
        raise ParameterError(
            f'eyes: {eyes!r}, but the source {name!r} has eyes of its own; must be {NO_EYES!r}'
        )
    eye_parameters = read(make_eyes.parameters)

    def make() -> Source:
        from checkweigher_driver.sources.machine import Machine  # which imports this module

        edges = make_eyes(eye_parameters)
        try:
            return Machine(make_source(parameters), edges)
        except BaseException:
            edges.close()
            raise

    return make
