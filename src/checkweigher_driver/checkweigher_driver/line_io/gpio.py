# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eyes and rejector on GPIO lines of a Linux machine, with the time stamps of the kernel."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import timedelta
import threading
import time
from typing import ClassVar

import gpiod
from gpiod.line import Bias, Clock, Direction, Edge, Value

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import Eye, EyeEdge
from checkweigher_driver.line_io.machine_inputs import InputParameters, InputPort, Reading
from checkweigher_driver.line_io.outputs import OutputPort
from checkweigher_driver.sources import EdgeSource, EyeEvent, EyesBack, EyesLost

_CONSUMER = 'checkweigher'
_BUFFER_SIZE = 1024  # events that the kernel keeps
_WAIT = 0.2  # s, after which `close` is noticed
_CLOSE_TIME = 1.0  # s
_Settings = dict[Iterable[int | str] | int | str, gpiod.LineSettings | None]
_BIASES = {
    'as_is': Bias.AS_IS,
    'disabled': Bias.DISABLED,
    'pull_up': Bias.PULL_UP,
    'pull_down': Bias.PULL_DOWN,
}


@dataclass(frozen=True)
class GpioEyesParameters(Parameters):
    """Which lines the photo-eyes are."""

    node: ClassVar[str] = 'gpio'

    chip: str = parameter('/dev/gpiochip0', 'device of the chip')
    infeed: int = parameter(0, 'offset of the line of the infeed eye', minimum=0)
    outfeed: int = parameter(1, 'offset of the line of the outfeed eye', minimum=0)
    infeed_active_low: bool = parameter(False, 'the line is low while the eye is blocked')
    outfeed_active_low: bool = parameter(False, 'the line is low while the eye is blocked')
    bias: str = parameter('as_is', 'bias of both lines', choices=tuple(_BIASES))
    debounce: float = parameter(
        0.0, 'for which a line has to keep its state, done by the kernel; edges come later by it',
        unit='s', minimum=0, maximum=1,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.infeed == self.outfeed:
            raise ParameterError(f'gpio.outfeed: {self.outfeed} is the infeed eye as well')


class EdgeOrder:
    """Make edges of the kernel's events, and notice those that were lost.

    The kernel numbers the events of a request from 1; when its buffer is full it drops the oldest.
    `eyes` are by the offset of their lines.
    """

    def __init__(self, eyes: dict[int, Eye]) -> None:
        self._eyes = eyes
        self._next = 1
        self._last_stamp = 0
        self.lost = 0

    def take(self, event: gpiod.EdgeEvent) -> list[EyeEvent]:
        """Return the edge of an event, after the loss that it shows, if any."""
        missing = event.global_seqno - self._next
        since = self._last_stamp
        self._next, self._last_stamp = event.global_seqno + 1, event.timestamp_ns
        rising = event.event_type is gpiod.EdgeEvent.Type.RISING_EDGE
        edge = EyeEdge(event.timestamp_ns, self._eyes[event.line_offset], rising)
        if missing <= 0:
            return [edge]
        self.lost += missing
        text = f'{missing} edges of the photo-eyes were lost: the machine did not keep up'
        return [EyesLost(since, text), EyesBack(event.timestamp_ns - 1), edge]


class GpioEyes(EdgeSource):
    """Photo-eyes whose edges have the stamps of the kernel, on the clock of the host."""

    parameters = GpioEyesParameters
    trouble = ''

    def __init__(self, parameters: GpioEyesParameters) -> None:
        lines = {
            parameters.infeed: (Eye.INFEED, parameters.infeed_active_low),
            parameters.outfeed: (Eye.OUTFEED, parameters.outfeed_active_low),
        }
        settings: _Settings = {
            offset: gpiod.LineSettings(
                direction=Direction.INPUT,
                edge_detection=Edge.BOTH,
                bias=_BIASES[parameters.bias],
                active_low=active_low,
                debounce_period=timedelta(seconds=parameters.debounce),
                event_clock=Clock.REALTIME,  # that of all stamps
            )
            for offset, (_, active_low) in lines.items()
        }
        self._request = _request(parameters.chip, settings, 'gpio')
        self._order = EdgeOrder({offset: eye for offset, (eye, _) in lines.items()})
        self._closing = threading.Event()
        self._ended = threading.Event()
        self._ended.set()
        self._edges = 0

    def figures(self) -> dict[str, float]:
        """Return what /diagnostics shows."""
        return {'edges': self._edges, 'edges lost': self._order.lost}

    def events(self) -> Iterator[EyeEvent]:
        """Yield edges until `close`; `OSError` if the chip is gone, until a new start."""
        self._ended.clear()
        try:
            while not self._closing.is_set():
                if not self._request.wait_edge_events(_WAIT):
                    continue
                for event in self._request.read_edge_events():
                    self._edges += 1
                    yield from self._order.take(event)
        except OSError as error:
            self.trouble = f'the photo-eyes are not read: gpio: {error.strerror or error}'
            raise
        finally:
            self._request.release()
            self._ended.set()

    def close(self) -> None:
        """End `events`."""
        self._closing.set()
        self._ended.wait(_WAIT + _CLOSE_TIME)


@dataclass(frozen=True)
class GpioOutputParameters(Parameters):
    """Which lines rejector, stop and belt are."""

    node: ClassVar[str] = 'gpio_outputs'

    chip: str = parameter('/dev/gpiochip0', 'device of the chip')
    reject: int = parameter(2, 'offset of the line of the rejector', minimum=0)
    reject_active_low: bool = parameter(False, 'the line is low while the rejector acts')
    stop: int = parameter(-1, 'offset of the line of the stop request; -1 for none', minimum=-1)
    stop_active_low: bool = parameter(
        True, 'the line is high while the line may run, so that a dead wire stops it'
    )
    permit: int = parameter(
        -1, 'offset of the line that is high while an accepted product passes the rejector; -1 for '
        'none', minimum=-1,
    )  # fmt: skip
    stations: tuple[float, ...] = parameter(
        (), 'offsets of the lines of the stations beside the rejector, in the order of '
        'reject.stations', minimum=0,
    )  # fmt: skip
    heartbeat: int = parameter(
        -1, 'offset of the line that changes with each cycle; -1 for none', minimum=-1
    )
    belt: int = parameter(
        -1, 'offset of an input that is on while the belt runs; -1 for none', minimum=-1
    )
    belt_active_low: bool = parameter(False, 'that input is low while the belt runs')

    def __post_init__(self) -> None:
        super().__post_init__()
        lines = self.reject, self.stop, self.permit, self.heartbeat, self.belt, *self.station_lines
        used = [line for line in lines if line >= 0]
        if len(set(used)) < len(used):
            raise ParameterError(
                'gpio_outputs: reject, stop, permit, stations, heartbeat and belt have to be '
                'different lines'
            )

    @property
    def station_lines(self) -> list[int]:
        """Lines of the stations beside the rejector."""
        return [int(line) for line in self.stations]


class GpioOutputs(OutputPort):
    """Rejector, stop, permit and heartbeat as lines, the belt as an input."""

    parameters = GpioOutputParameters

    def __init__(self, parameters: GpioOutputParameters) -> None:
        self._parameters = parameters
        self.name = f'gpio-{parameters.chip}-{parameters.reject}'
        self.permits = parameters.permit >= 0
        self.stations = len(parameters.stations)
        self._request: gpiod.LineRequest | None = None
        self._beat = False

    def open(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> None:
        """Ask the kernel for the lines, and have it set them at once."""
        wanted = self._parameters
        inverted: dict[int | str, bool] = {
            wanted.reject: wanted.reject_active_low,
            wanted.stop: wanted.stop_active_low,
        }
        settings: _Settings = {
            offset: gpiod.LineSettings(
                direction=Direction.OUTPUT,
                active_low=inverted.get(offset, False),
                output_value=value,
            )
            for offset, value in self._values(reject, stop, permit, stations).items()
        }
        if wanted.belt >= 0:
            settings[wanted.belt] = gpiod.LineSettings(
                direction=Direction.INPUT, active_low=wanted.belt_active_low
            )
        self._request = _request(wanted.chip, settings, 'gpio_outputs')

    def switch(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> None:
        """Set the lines."""
        self._lines.set_values(self._values(reject, stop, permit, stations))

    def refresh(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> bool | None:
        """Set the lines and change the heartbeat, and read the belt."""
        self._beat = not self._beat
        self.switch(reject=reject, stop=stop, permit=permit, stations=stations)
        if self._parameters.belt < 0:
            return None
        return self._lines.get_value(self._parameters.belt) is Value.ACTIVE

    def _values(
        self, reject: bool, stop: bool, permit: bool, stations: Sequence[bool]
    ) -> dict[int | str, Value]:
        wanted = self._parameters
        levels = (
            (wanted.reject, reject),
            (wanted.stop, stop),
            (wanted.permit, permit),
            (wanted.heartbeat, self._beat),
            *zip(wanted.station_lines, stations, strict=True),
        )
        return {offset: Value(int(level)) for offset, level in levels if offset >= 0}

    @property
    def _lines(self) -> gpiod.LineRequest:
        if self._request is None:
            raise OSError(f'gpio_outputs.chip: {self._parameters.chip}: the lines are not open')
        return self._request

    def close(self) -> None:
        """Give the lines back to the kernel."""
        if self._request is not None:
            self._request.release()
            self._request = None


@dataclass(frozen=True)
class GpioInputParameters(InputParameters):
    """Which inputs the machine has."""

    node: ClassVar[str] = 'gpio_inputs'

    chip: str = parameter('/dev/gpiochip0', 'device of the chip')
    bias: str = parameter('as_is', 'bias of the lines', choices=tuple(_BIASES))

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.wiring().values()) < 0:
            raise ParameterError('gpio_inputs: offsets of lines are 0 or more')


class GpioInputs(InputPort):
    """Inputs of the machine whose edges have the stamps of the kernel."""

    parameters = GpioInputParameters

    def __init__(self, parameters: GpioInputParameters) -> None:
        self._parameters = parameters
        self._names = {address: name for name, address in parameters.wiring().items()}
        self._request: gpiod.LineRequest | None = None
        self._levels: dict[str, bool] = {}

    def open(self) -> None:
        """Ask the kernel for the lines."""
        settings: _Settings = {
            offset: gpiod.LineSettings(
                direction=Direction.INPUT,
                edge_detection=Edge.BOTH,
                bias=_BIASES[self._parameters.bias],
                active_low=self._parameters.is_inverted(name),
                event_clock=Clock.REALTIME,
            )
            for offset, name in self._names.items()
        }
        self._request = _request(self._parameters.chip, settings, 'gpio_inputs')
        self._levels = {}

    def read(self) -> list[Reading]:
        """Return the edges that have come, and after them the lines as they are now."""
        if self._request is None:
            raise OSError(f'gpio_inputs.chip: {self._parameters.chip}: the lines are not open')
        found = []
        if self._levels and self._request.wait_edge_events(_WAIT):
            for event in self._request.read_edge_events():
                name = self._names[event.line_offset]
                self._levels[name] = event.event_type is gpiod.EdgeEvent.Type.RISING_EDGE
                found.append(Reading(event.timestamp_ns, dict(self._levels)))
        else:
            values = self._request.get_values(list(self._names))
            now = {n: v is Value.ACTIVE for n, v in zip(self._names.values(), values, strict=True)}
            self._levels = now
            found.append(Reading(time.time_ns(), dict(now)))
        return found

    def close(self) -> None:
        """Give the lines back to the kernel."""
        if self._request is not None:
            self._request.release()
            self._request = None


def _request(chip: str, settings: _Settings, node: str) -> gpiod.LineRequest:
    """Return the lines of a chip, or raise ParameterError."""
    try:
        return gpiod.request_lines(
            chip, config=settings, consumer=_CONSUMER, event_buffer_size=_BUFFER_SIZE
        )
    except PermissionError:
        raise ParameterError(
            f'{node}.chip: {chip}: no permission; add the user to the group that owns the device'
        ) from None
    except OSError as error:
        why = error.strerror or str(error)
        raise ParameterError(
            f'{node}.chip: {chip}: {why}; gpiodetect and gpioinfo show chips and lines in use'
        ) from None
    except ValueError as error:
        raise ParameterError(f'{node}.chip: {chip}: {error}') from None
