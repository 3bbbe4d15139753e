# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eyes, outputs and inputs on GPIO lines of a Linux computer. The kernel stamps the edges."""

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
import time
from typing import ClassVar

import gpiod
from gpiod.line import Bias, Clock, Direction, Edge, Value

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import Eye, EyeEdge
from checkweigher_driver.line_io.machine_inputs import InputParameters, InputPort, Reading
from checkweigher_driver.line_io.outputs import OutputPort
from checkweigher_driver.line_io.rejector.switching import Levels
from checkweigher_driver.sources import EdgeSource, EyeEvent, EyesBack, EyesLost

_CONSUMER = 'checkweigher'
_BUFFER_SIZE = 1024  # number of events that the buffer of the kernel can hold
_WAIT = 0.2  # longest wait in s for an event
_Settings = dict[Iterable[int | str] | int | str, gpiod.LineSettings | None]
_BIASES = {
    'as_is': Bias.AS_IS,
    'disabled': Bias.DISABLED,
    'pull_up': Bias.PULL_UP,
    'pull_down': Bias.PULL_DOWN,
}
_line = partial(parameter, -1, minimum=-1)


@dataclass(frozen=True)
class GpioEyesParameters(Parameters):
    """Parameters of the GPIO lines of the photo-eyes."""

    node: ClassVar[str] = 'gpio'

    chip: str = parameter('/dev/gpiochip0', 'device file of the GPIO chip')
    infeed: int = parameter(0, 'line offset of the infeed eye', minimum=0)
    outfeed: int = parameter(1, 'line offset of the outfeed eye', minimum=0)
    infeed_active_low: bool = parameter(False, 'whether the line is low while the eye is blocked')
    outfeed_active_low: bool = parameter(False, 'whether the line is low while the eye is blocked')
    bias: str = parameter('as_is', 'bias of both lines', choices=tuple(_BIASES))
    debounce: float = parameter(
        0.0,
        'debounce time of the kernel, by which all edges are delayed',
        unit='s',
        minimum=0,
        maximum=1,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.infeed == self.outfeed:
            raise ParameterError(f'gpio.outfeed: {self.outfeed} is also the line of the infeed eye')


class EdgeOrder:
    """Conversion of kernel events to edges, with detection of lost events.

    The kernel numbers the events from 1, and drops the oldest event if its buffer is full. `eyes`
    maps the offset of each line to its photo-eye.
    """

    def __init__(self, eyes: dict[int, Eye]) -> None:
        self._eyes = eyes
        self._next = 1
        self._last_stamp = 0
        self.lost = 0

    def take(self, event: gpiod.EdgeEvent) -> list[EyeEvent]:
        """Return the edge that an event of the kernel reports.

        If events were lost before this event, the edge is preceded by the start and the end of a
        loss of the eyes.
        """
        missing = event.global_seqno - self._next
        since = self._last_stamp
        self._next, self._last_stamp = event.global_seqno + 1, event.timestamp_ns
        edge = EyeEdge(event.timestamp_ns, self._eyes[event.line_offset], _is_rising(event))
        if missing <= 0:
            return [edge]
        self.lost += missing
        text = f'{missing} edges of the photo-eyes were lost, because the computer was too slow'
        return [EyesLost(since, text), EyesBack(event.timestamp_ns - 1), edge]


class GpioEyes(EdgeSource):
    """Photo-eyes on GPIO lines. The kernel stamps the edges on the real-time clock."""

    parameters = GpioEyesParameters
    trouble = ''

    def __init__(self, parameters: GpioEyesParameters) -> None:
        wanted, debounce = parameters, timedelta(seconds=parameters.debounce)
        settings: _Settings = {
            wanted.infeed: _edges_of(wanted.bias, wanted.infeed_active_low, debounce),
            wanted.outfeed: _edges_of(wanted.bias, wanted.outfeed_active_low, debounce),
        }
        self._request = _request(wanted.chip, settings, 'gpio')
        self._order = EdgeOrder({wanted.infeed: Eye.INFEED, wanted.outfeed: Eye.OUTFEED})
        super().__init__(parameters)
        self._edges = 0

    def figures(self) -> dict[str, float]:
        """Return the numbers of received and lost edges for the diagnostics, by name."""
        return {'edges': self._edges, 'edges lost': self._order.lost}

    def events(self) -> Iterator[EyeEvent]:
        """Yield edges, and the start and end of each loss of the eyes, until `close` is called.

        Raises OSError if the GPIO chip disappears.
        """
        with self._request:
            while not self._closing.is_set():
                try:
                    ready = self._request.wait_edge_events(_WAIT)
                    events = self._request.read_edge_events() if ready else []
                except OSError as error:
                    self.trouble = f'the photo-eyes cannot be read: gpio: {error.strerror or error}'
                    raise
                for event in events:
                    self._edges += 1
                    yield from self._order.take(event)


@dataclass(frozen=True)
class GpioOutputParameters(Parameters):
    """Parameters of the GPIO lines of the outputs and the belt input."""

    node: ClassVar[str] = 'gpio_outputs'

    chip: str = parameter('/dev/gpiochip0', 'device file of the GPIO chip')
    reject: int = parameter(2, 'line offset of the rejector', minimum=0)
    reject_active_low: bool = parameter(False, 'whether the output is low while the rejector acts')
    stop: int = _line('line offset of the stop output; -1 for none')
    stop_active_low: bool = parameter(
        True, 'whether the stop output is low during a stop; if true, a broken wire stops the belt'
    )
    permit: int = _line(
        'line offset of the output that is high while an accepted product passes the rejector; '
        '-1 for none'
    )
    stations: tuple[float, ...] = parameter(
        (), 'line offsets of the sorting stations, in the order of reject.stations', minimum=0
    )
    heartbeat: int = _line('line offset of the output that changes in each cycle; -1 for none')
    belt: int = _line('line offset of the input that is on while the belt runs; -1 for none')
    belt_active_low: bool = parameter(False, 'whether the belt input is low while the belt runs')

    def __post_init__(self) -> None:
        super().__post_init__()
        lines = self.reject, self.stop, self.permit, self.heartbeat, self.belt, *self.station_lines
        if max(Counter(line for line in lines if line >= 0).values()) > 1:
            raise ParameterError(
                'gpio_outputs: reject, stop, permit, stations, heartbeat and belt must be '
                'different lines'
            )

    @property
    def station_lines(self) -> list[int]:
        """Line offsets of the sorting stations."""
        return [int(line) for line in self.stations]


class GpioOutputs(OutputPort):
    """Outputs and belt input on GPIO lines."""

    parameters = GpioOutputParameters

    def __init__(self, parameters: GpioOutputParameters) -> None:
        self._parameters = parameters
        self.name = f'gpio-{parameters.chip}-{parameters.reject}'
        self.permits = parameters.permit >= 0
        self.stations = len(parameters.stations)
        self._opened = ExitStack()
        self._lines: gpiod.LineRequest
        self._beat = False

    def open(self, levels: Levels) -> None:
        """Request the lines from the kernel, and set their levels."""
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
            for offset, value in self._values(levels).items()
        }
        if wanted.belt >= 0:
            settings[wanted.belt] = gpiod.LineSettings(
                direction=Direction.INPUT, active_low=wanted.belt_active_low
            )
        self._lines = self._opened.enter_context(_request(wanted.chip, settings, 'gpio_outputs'))

    def switch(self, levels: Levels) -> None:
        """Set the levels of the lines."""
        self._lines.set_values(self._values(levels))

    def refresh(self, levels: Levels) -> bool | None:
        """Set the levels of the lines, toggle the heartbeat, and read the belt input.

        Return whether the belt runs, or None without a belt input.
        """
        self._beat = not self._beat
        self.switch(levels)
        if self._parameters.belt < 0:
            return None
        return self._lines.get_value(self._parameters.belt) is Value.ACTIVE

    def _values(self, levels: Levels) -> dict[int | str, Value]:
        wanted = self._parameters
        of_lines = (
            (wanted.reject, levels.reject),
            (wanted.stop, levels.stop),
            (wanted.permit, levels.permit),
            (wanted.heartbeat, self._beat),
            *zip(wanted.station_lines, levels.stations, strict=True),
        )
        return {offset: Value(int(level)) for offset, level in of_lines if offset >= 0}

    def close(self) -> None:
        """Release the lines."""
        self._opened.close()


@dataclass(frozen=True)
class GpioInputParameters(InputParameters):
    """Parameters of the GPIO lines of the machine inputs."""

    node: ClassVar[str] = 'gpio_inputs'

    chip: str = parameter('/dev/gpiochip0', 'device file of the GPIO chip')
    bias: str = parameter('as_is', 'bias of all lines', choices=tuple(_BIASES))

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.wiring().values()) < 0:
            raise ParameterError('gpio_inputs: line offsets must be 0 or more')


class GpioInputs(InputPort):
    """Machine inputs on GPIO lines. The kernel stamps the edges on the real-time clock."""

    parameters = GpioInputParameters

    def __init__(self, parameters: GpioInputParameters) -> None:
        self._parameters = parameters
        self._names = {address: name for name, address in parameters.wiring().items()}
        self._opened = ExitStack()
        self._lines: gpiod.LineRequest
        self._levels: dict[str, bool] = {}

    def open(self) -> None:
        """Request the lines from the kernel."""
        wanted = self._parameters
        settings: _Settings = {
            offset: _edges_of(wanted.bias, wanted.is_inverted(name))
            for offset, name in self._names.items()
        }
        self._lines = self._opened.enter_context(_request(wanted.chip, settings, 'gpio_inputs'))
        self._levels = {}

    def read(self) -> list[Reading]:
        """Return a reading for each edge since the last call.

        At the first call after `open`, or if there was no edge within 0.2 s, return one reading of
        the present levels.
        """
        if not self._levels or not self._lines.wait_edge_events(_WAIT):
            values = self._lines.get_values(list(self._names))
            on = (value is Value.ACTIVE for value in values)
            self._levels = dict(zip(self._names.values(), on, strict=True))
            return [Reading(time.time_ns(), dict(self._levels))]
        found = []
        for event in self._lines.read_edge_events():
            self._levels[self._names[event.line_offset]] = _is_rising(event)
            found.append(Reading(event.timestamp_ns, dict(self._levels)))
        return found

    def close(self) -> None:
        """Release the lines."""
        self._opened.close()


def _is_rising(event: gpiod.EdgeEvent) -> bool:
    return event.event_type is gpiod.EdgeEvent.Type.RISING_EDGE


def _edges_of(
    bias: str, active_low: bool, debounce: timedelta = timedelta(0)
) -> gpiod.LineSettings:
    """Return the settings of an input whose edges have stamps on the real-time clock."""
    return gpiod.LineSettings(
        direction=Direction.INPUT,
        edge_detection=Edge.BOTH,
        bias=_BIASES[bias],
        active_low=active_low,
        debounce_period=debounce,
        event_clock=Clock.REALTIME,
    )


def _request(chip: str, settings: _Settings, node: str) -> gpiod.LineRequest:
    try:
        return gpiod.request_lines(
            chip, config=settings, consumer=_CONSUMER, event_buffer_size=_BUFFER_SIZE
        )
    except PermissionError:
        why = 'no permission; add the user to the group that owns the device'
    except OSError as error:
        why = f'{error.strerror or error}; list chips and used lines with gpiodetect and gpioinfo'
    except ValueError as error:
        why = str(error)
    raise ParameterError(f'{node}.chip: {chip}: {why}')
