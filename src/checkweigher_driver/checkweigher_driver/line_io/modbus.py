# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eyes, outputs and inputs of a PLC or a bus coupler, connected by Modbus TCP."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
import time
from typing import ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import NANOSECONDS
from checkweigher_driver.line_io.clock_steps import read_clocks
from checkweigher_driver.line_io.edge_polling import EdgePolling, Poll
from checkweigher_driver.line_io.machine_inputs import InputParameters, InputPort, Reading
from checkweigher_driver.line_io.modbus_link import ModbusLink, ModbusLinkError
from checkweigher_driver.line_io.outputs import OutputPort
from checkweigher_driver.line_io.rejector.switching import Levels
from checkweigher_driver.sources import RETRY_TIME, EdgeSource, EyeEvent

_MAX_INPUTS = 64  # largest number of inputs in one request
_LAST_ADDRESS = 65535
_address = partial(parameter, minimum=0, maximum=_LAST_ADDRESS)
_optional_address = partial(parameter, -1, minimum=-1, maximum=_LAST_ADDRESS)
_delay = partial(parameter, unit='s', minimum=0, maximum=1)


@dataclass(frozen=True)
class _DeviceParameters(Parameters):
    """Parameters of the connection to a Modbus device."""

    host: str = parameter('localhost', 'host name or IP address of the device')
    port: int = parameter(502, 'TCP port of the device', minimum=1, maximum=65535)
    device_id: int = parameter(1, 'unit identifier of the device', minimum=0, maximum=255)
    timeout: float = parameter(
        0.2, 'longest wait for a connection or an answer', unit='s', minimum=0.01, maximum=60
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.host.strip():
            raise ParameterError(f'{self.node}.host: empty, must be the host name of the device')

    def link(self) -> ModbusLink:
        """Return an unconnected link to the device."""
        return ModbusLink(self.host, self.port, self.device_id, self.timeout)


@dataclass(frozen=True)
class ModbusEyesParameters(_DeviceParameters):
    """Parameters of photo-eyes that are polled by Modbus TCP."""

    node: ClassVar[str] = 'modbus'

    inputs: str = parameter('discrete', 'kind of the inputs', choices=('discrete', 'coil'))
    infeed: int = _address(0, 'address of the infeed eye')
    outfeed: int = _address(1, 'address of the outfeed eye')
    infeed_inverted: bool = parameter(False, 'whether the input is on while the eye is clear')
    outfeed_inverted: bool = parameter(False, 'whether the input is on while the eye is clear')
    poll_period: float = _delay(0.002, 'period of the polls')
    delay: float = _delay(
        0.0, 'mean delay of an input, which its filter and the cycle of the PLC cause'
    )
    max_uncertainty: float = _delay(
        0.01,
        'largest uncertainty of the time of an edge; a less certain edge counts as a loss of the '
        'eyes',
        minimum=1e-4,
    )
    longest_gap: float = _delay(
        0.05,
        'longest time without a poll; a longer time counts as a loss of the eyes, because a '
        'product may have passed',
        minimum=1e-3,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.infeed == self.outfeed:
            raise ParameterError(f'modbus.outfeed: {self.outfeed} is the address of both eyes')
        if abs(self.infeed - self.outfeed) >= _MAX_INPUTS:
            raise ParameterError(
                f'modbus.outfeed: {self.outfeed} is too far from infeed {self.infeed} for one '
                f'request; choose addresses that differ by at most {_MAX_INPUTS - 1}'
            )
        if self.poll_period / 2 > self.max_uncertainty:
            raise ParameterError(
                f'modbus.poll_period: half of {self.poll_period:g} s is more than max_uncertainty '
                f'{self.max_uncertainty:g} s; choose a shorter period'
            )


class ModbusEyes(EdgeSource):
    """Photo-eyes that are polled by Modbus TCP.

    The eyes count as lost while the device cannot be reached.
    """

    parameters = ModbusEyesParameters
    trouble = 'the photo-eyes have not been read yet'

    def __init__(self, parameters: ModbusEyesParameters) -> None:
        self._parameters = parameters
        self._link = parameters.link()
        self._polling = EdgePolling(
            max_uncertainty=round(parameters.max_uncertainty * NANOSECONDS),
            longest_gap=round(parameters.longest_gap * NANOSECONDS),
            delay=round(parameters.delay * NANOSECONDS),
        )
        super().__init__(parameters)

    def figures(self) -> dict[str, float]:
        """Return values on the polls for the diagnostics, by name."""
        return self._polling.figures()

    def events(self) -> Iterator[EyeEvent]:
        """Yield edges, and the start and end of each loss of the eyes, until `close` is called."""
        try:
            while not self._closing.is_set():
                begin = time.monotonic_ns()
                try:
                    self._link.connect()
                    poll = self._poll()
                except ModbusLinkError as error:
                    self.trouble = f'the photo-eyes cannot be read: {error}'
                    yield from self._polling.lose(begin, _to_stamp(), self.trouble)
                    self._closing.wait(RETRY_TIME)
                    continue
                self.trouble = ''
                yield from self._polling.add(poll, _to_stamp())
                rest = begin / NANOSECONDS + self._parameters.poll_period - time.monotonic()
                self._closing.wait(max(rest, 0.0))
        finally:
            self._link.close()

    def _poll(self) -> Poll:
        wanted, begin = self._parameters, time.monotonic_ns()
        bits = self._link.read_inputs(wanted.inputs, (wanted.infeed, wanted.outfeed))
        end = time.monotonic_ns()
        blocked = (
            bits[wanted.infeed] != wanted.infeed_inverted,
            bits[wanted.outfeed] != wanted.outfeed_inverted,
        )
        return Poll(begin, end, blocked)


def _to_stamp() -> int:
    """Return real time minus monotonic time in ns.

    The function is called at each poll, so that a step of the clock of the host shifts edges and
    samples by the same time.
    """
    monotonic, real = read_clocks()
    return real - monotonic


@dataclass(frozen=True)
class ModbusOutputParameters(_DeviceParameters):
    """Parameters of the coils of the outputs, the watchdog register and the belt input."""

    node: ClassVar[str] = 'modbus_outputs'

    reject: int = _address(0, 'coil of the rejector')
    reject_inverted: bool = parameter(False, 'whether the coil is off while the rejector acts')
    stop: int = _optional_address('coil of the stop output; -1 for none')
    stop_inverted: bool = parameter(
        True, 'whether the coil is off during a stop; if true, a broken wire stops the belt'
    )
    permit: int = _optional_address(
        'coil that is on while an accepted product passes the rejector; -1 for none'
    )
    stations: tuple[float, ...] = _address(
        (), 'coils of the sorting stations, in the order of reject.stations'
    )
    watchdog: int = _optional_address(
        'holding register that is incremented in each cycle; -1 for none'
    )
    belt: int = _optional_address('discrete input that is on while the belt runs; -1 for none')
    belt_inverted: bool = parameter(False, 'whether the belt input is off while the belt runs')

    def __post_init__(self) -> None:
        super().__post_init__()
        used = {self.reject: 'the rejector'}
        for name, coil, what in (
            ('stop', self.stop, 'the stop request'),
            ('permit', self.permit, 'the permit'),
            *(('stations', coil, 'another station') for coil in self.station_coils),
        ):
            if coil in used:
                raise ParameterError(
                    f'modbus_outputs.{name}: coil {coil} is also used for {used[coil]}'
                )
            if coil >= 0:
                used[coil] = what

    @property
    def station_coils(self) -> list[int]:
        """Coil addresses of the sorting stations."""
        return [int(coil) for coil in self.stations]


class ModbusOutputs(OutputPort):
    """Outputs as Modbus coils, with a watchdog register and a discrete input for the belt."""

    parameters = ModbusOutputParameters

    def __init__(self, parameters: ModbusOutputParameters) -> None:
        self._parameters = parameters
        self.name = (
            f'modbus-{parameters.host}-{parameters.port}-{parameters.device_id}-{parameters.reject}'
        )
        self.permits = parameters.permit >= 0
        self.stations = len(parameters.stations)
        self._link = parameters.link()
        self._cycles = 0
        self._written: dict[int, bool] = {}

    def open(self, levels: Levels) -> None:
        """Connect to the device, and write all coils."""
        self._link.connect()
        self._write(self._coils(levels))

    def switch(self, levels: Levels) -> None:
        """Write the coils whose states differ from the states written last."""
        coils = self._coils(levels).items()
        self._write({address: on for address, on in coils if self._written.get(address) != on})

    def refresh(self, levels: Levels) -> bool | None:
        """Write all coils and the watchdog register, and read the belt input.

        Return whether the belt runs, or None without a belt input.
        """
        self._write(self._coils(levels))
        wanted = self._parameters
        if wanted.watchdog >= 0:
            self._cycles = (self._cycles + 1) % 2**16
            self._link.write_register(wanted.watchdog, self._cycles)
        if wanted.belt < 0:
            return None
        return (
            self._link.read_inputs('discrete', (wanted.belt,))[wanted.belt] != wanted.belt_inverted
        )

    def _coils(self, levels: Levels) -> dict[int, bool]:
        wanted = self._parameters
        coils = {
            wanted.reject: levels.reject != wanted.reject_inverted,
            **dict(zip(wanted.station_coils, levels.stations, strict=True)),
            wanted.stop: levels.stop != wanted.stop_inverted,
            wanted.permit: levels.permit,
        }
        return {coil: value for coil, value in coils.items() if coil >= 0}

    def _write(self, coils: dict[int, bool]) -> None:
        for address, value in coils.items():
            self._link.write_coil(address, value)
            self._written[address] = value

    def close(self) -> None:
        """Close the connection."""
        self._link.close()


@dataclass(frozen=True)
class ModbusInputParameters(_DeviceParameters, InputParameters):
    """Parameters of machine inputs that are polled by Modbus TCP."""

    node: ClassVar[str] = 'modbus_inputs'

    inputs: str = parameter('discrete', 'kind of the inputs', choices=('discrete', 'coil'))
    poll_period: float = _delay(
        0.005, 'period of the polls; a reject signal must last longer', maximum=0.2
    )
    delay: float = _delay(
        0.0, 'mean delay of an input, which its filter and the cycle of the PLC cause'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        addresses = self.wiring().values()
        if not 0 <= min(addresses) <= max(addresses) <= _LAST_ADDRESS:
            raise ParameterError(f'modbus_inputs: addresses must be 0..{_LAST_ADDRESS}')
        if max(addresses) - min(addresses) >= _MAX_INPUTS:
            raise ParameterError(
                f'modbus_inputs: {min(addresses)} to {max(addresses)} are more than {_MAX_INPUTS} '
                'addresses; one request cannot read all'
            )


class ModbusInputs(InputPort):
    """Machine inputs on Modbus TCP. One request reads all inputs."""

    parameters = ModbusInputParameters

    def __init__(self, parameters: ModbusInputParameters) -> None:
        self._parameters = parameters
        self._wiring = parameters.wiring()
        self._link = parameters.link()
        self._next = time.monotonic()

    def open(self) -> None:
        """Connect to the device."""
        self._link.connect()

    def read(self) -> list[Reading]:
        """Wait for the end of the poll period, and return one reading of all inputs."""
        time.sleep(max(0.0, self._next - time.monotonic()))
        self._next = time.monotonic() + self._parameters.poll_period
        begin = time.time_ns()
        bits = self._link.read_inputs(self._parameters.inputs, self._wiring.values())
        stamp = (begin + time.time_ns()) // 2 - round(self._parameters.delay * NANOSECONDS)
        inverted = self._parameters.is_inverted
        levels = {name: bits[at] != inverted(name) for name, at in self._wiring.items()}
        return [Reading(stamp, levels)]

    def close(self) -> None:
        """Close the connection."""
        self._link.close()
