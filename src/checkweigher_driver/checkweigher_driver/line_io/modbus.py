# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eyes and rejector on a PLC or a bus coupler by Modbus TCP."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import threading
import time
from typing import ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import NANOSECONDS
from checkweigher_driver.line_io.clock_steps import read_clocks
from checkweigher_driver.line_io.edge_polling import EdgePolling, Poll
from checkweigher_driver.line_io.machine_inputs import InputParameters, InputPort, Reading
from checkweigher_driver.line_io.modbus_link import ModbusLink, ModbusLinkError
from checkweigher_driver.line_io.outputs import OutputPort
from checkweigher_driver.sources import EdgeSource, EyeEvent

_MAX_INPUTS = 64  # that one request spans
_FIRST_BACKOFF, _LONGEST_BACKOFF = 0.1, 2.0  # s
_LAST_ADDRESS = 65535
_CLOSE_TIME = 1.0  # s


@dataclass(frozen=True)
class _DeviceParameters(Parameters):
    """Where the device is."""

    host: str = parameter('', 'name or address of the device')
    port: int = parameter(502, 'TCP port of the device', minimum=1, maximum=65535)
    device_id: int = parameter(1, 'unit of the device behind a gateway', minimum=0, maximum=255)
    timeout: float = parameter(
        0.2, 'longest time for connecting and for each answer', unit='s', minimum=0.01, maximum=60
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.host.strip():
            raise ParameterError(f'{self.node}.host: empty, must name the device')

    def link(self) -> ModbusLink:
        """Return the connection, not yet made."""
        return ModbusLink(self.host, self.port, self.device_id, self.timeout)


@dataclass(frozen=True)
class ModbusEyesParameters(_DeviceParameters):
    """Which inputs the photo-eyes are, and how often they are read."""

    node: ClassVar[str] = 'modbus'

    host: str = parameter('localhost', 'name or address of the device')
    inputs: str = parameter('discrete', 'discrete inputs or coils', choices=('discrete', 'coil'))
    infeed: int = parameter(0, 'address of the infeed eye', minimum=0, maximum=_LAST_ADDRESS)
    outfeed: int = parameter(1, 'address of the outfeed eye', minimum=0, maximum=_LAST_ADDRESS)
    infeed_inverted: bool = parameter(False, 'the input is on while the eye is clear')
    outfeed_inverted: bool = parameter(False, 'the input is on while the eye is clear')
    poll_period: float = parameter(
        0.002, 'time from one reading of the eyes to the next', unit='s', minimum=0, maximum=1
    )
    delay: float = parameter(
        0.0, 'delay of an input by filter and cycle', unit='s', minimum=0, maximum=1
    )
    max_uncertainty: float = parameter(
        0.01, 'largest uncertainty of the time of an edge; more counts as eyes lost', unit='s',
        minimum=1e-4, maximum=1,
    )  # fmt: skip
    longest_gap: float = parameter(
        0.05, 'longest time without a reading; after it a product may have passed unseen', unit='s',
        minimum=1e-3, maximum=1,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.infeed == self.outfeed:
            raise ParameterError(f'modbus.outfeed: {self.outfeed} is the infeed eye as well')
        if abs(self.infeed - self.outfeed) >= _MAX_INPUTS:
            raise ParameterError(
                f'modbus.outfeed: {self.outfeed} is {_MAX_INPUTS} or more from the infeed eye at '
                f'{self.infeed}; one request cannot read both'
            )
        if self.poll_period / 2 > self.max_uncertainty:
            raise ParameterError(
                f'modbus.poll_period: {self.poll_period:g} s makes every edge less certain than '
                f'max_uncertainty {self.max_uncertainty:g} s'
            )


class ModbusEyes(EdgeSource):
    """Both eyes, polled; a device that is not there is waited for, with the eyes lost."""

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
        self._closing = threading.Event()
        self._ended = threading.Event()
        self._ended.set()
        self._timing = _PollTiming()

    def figures(self) -> dict[str, float]:
        """Return what /diagnostics shows; times in ms.

        ``edge uncertainty`` is that of a typical edge, by the mean period and round trip,
        ``largest edge uncertainty`` that of the worst edge that was taken.
        """
        return {
            **self._timing.shown(),
            'largest edge uncertainty ms': 1e-6 * self._polling.worst_uncertainty,
            'eye losses': self._polling.losses,
        }

    def events(self) -> Iterator[EyeEvent]:
        """Yield edges, and when the eyes were lost and came back, until `close`."""
        self._ended.clear()
        try:
            backoff = _FIRST_BACKOFF
            while not self._closing.is_set():
                begin = time.monotonic_ns()
                try:
                    self._link.connect()
                    poll = self._poll()
                except ModbusLinkError as error:
                    self.trouble = f'the photo-eyes are not read: {error}'
                    self._timing.interrupt()
                    yield from self._polling.lose(begin, _to_stamp(), self.trouble)
                    self._closing.wait(backoff)
                    backoff = min(2 * backoff, _LONGEST_BACKOFF)
                    continue
                backoff = _FIRST_BACKOFF
                self.trouble = ''
                yield from self._polling.add(poll, _to_stamp())
                rest = begin / NANOSECONDS + self._parameters.poll_period - time.monotonic()
                if rest > 0:
                    self._closing.wait(rest)
        finally:
            self._link.close()
            self._ended.set()

    def _poll(self) -> Poll:
        wanted = self._parameters
        first = min(wanted.infeed, wanted.outfeed)
        begin = time.monotonic_ns()
        bits = self._link.read_bits(wanted.inputs, first, abs(wanted.infeed - wanted.outfeed) + 1)
        end = time.monotonic_ns()
        self._timing.add(begin, end)
        infeed = bits[wanted.infeed - first] != wanted.infeed_inverted
        outfeed = bits[wanted.outfeed - first] != wanted.outfeed_inverted
        return Poll(begin, end, (infeed, outfeed))

    def close(self) -> None:
        """End `events` after the request that is under way."""
        self._closing.set()
        self._ended.wait(self._parameters.timeout + _CLOSE_TIME)


class _PollTiming:
    """Period and round trip of polls that follow one another, ns."""

    def __init__(self) -> None:
        self._polls = self._periods = self._round_trips = self._longest_round_trip = 0
        self._last_begin: int | None = None

    def add(self, begin: int, end: int) -> None:
        """Take a poll."""
        if self._last_begin is not None:
            self._polls += 1
            self._periods += begin - self._last_begin
            self._round_trips += end - begin
            self._longest_round_trip = max(self._longest_round_trip, end - begin)
        self._last_begin = begin

    def interrupt(self) -> None:
        """Note that a poll failed: the next one follows none."""
        self._last_begin = None

    def shown(self) -> dict[str, float]:
        """Return the figures by their names in /diagnostics."""
        polls = max(self._polls, 1)
        period, round_trip = 1e-6 * self._periods / polls, 1e-6 * self._round_trips / polls
        return {
            'polls': self._polls,
            'poll period ms': period,
            'round trip ms': round_trip,
            'longest round trip ms': 1e-6 * self._longest_round_trip,
            'edge uncertainty ms': (period + round_trip) / 2,
        }


def _to_stamp() -> int:
    """Return stamp less monotonic time, ns.

    Asked for at each poll, so that a step of the host's clock does not part the edges from the
    samples.
    """
    monotonic, real = read_clocks()
    return real - monotonic


@dataclass(frozen=True)
class ModbusOutputParameters(_DeviceParameters):
    """Which coils rejector and stop are, and the watchdog of the device."""

    node: ClassVar[str] = 'modbus_outputs'

    host: str = parameter('localhost', 'name or address of the device')
    reject: int = parameter(0, 'coil of the rejector', minimum=0, maximum=_LAST_ADDRESS)
    reject_inverted: bool = parameter(False, 'the coil is off while the rejector acts')
    stop: int = parameter(
        -1, 'coil of the stop request; -1 for none', minimum=-1, maximum=_LAST_ADDRESS
    )
    stop_inverted: bool = parameter(
        True, 'the coil is on while the line may run, so that a dead wire stops it'
    )
    permit: int = parameter(
        -1, 'coil that is on while an accepted product passes the rejector; -1 for none',
        minimum=-1, maximum=_LAST_ADDRESS,
    )  # fmt: skip
    stations: tuple[float, ...] = parameter(
        (), 'coils of the stations beside the rejector, in the order of reject.stations',
        minimum=0, maximum=_LAST_ADDRESS,
    )  # fmt: skip
    watchdog: int = parameter(
        -1, 'holding register that counts up with each cycle; -1 for none', minimum=-1,
        maximum=_LAST_ADDRESS,
    )  # fmt: skip
    belt: int = parameter(
        -1, 'discrete input that is on while the belt runs; -1 for none', minimum=-1,
        maximum=_LAST_ADDRESS,
    )  # fmt: skip
    belt_inverted: bool = parameter(False, 'the input is on while the belt stands')

    def __post_init__(self) -> None:
        super().__post_init__()
        used = {self.reject: 'the rejector'}
        for name, coil, what in (
            ('stop', self.stop, 'the stop request'), ('permit', self.permit, 'the permit'),
            *(('stations', coil, 'another station') for coil in self.station_coils),
        ):  # fmt: skip
            if coil in used:
                raise ParameterError(f'modbus_outputs.{name}: coil {coil} is {used[coil]} as well')
            if coil >= 0:
                used[coil] = what

    @property
    def station_coils(self) -> list[int]:
        """Coils of the stations beside the rejector."""
        return [int(coil) for coil in self.stations]


class ModbusOutputs(OutputPort):
    """Rejector, stop and permit as coils, the belt as an input, and a register that counts."""

    parameters = ModbusOutputParameters

    def __init__(self, parameters: ModbusOutputParameters) -> None:
        self._parameters = parameters
        self.name = '-'.join(
            map(str, ('modbus', parameters.host, parameters.port, parameters.device_id,
                      parameters.reject))
        )  # fmt: skip
        self.permits = parameters.permit >= 0
        self.stations = len(parameters.stations)
        self._link = parameters.link()
        self._cycles = 0
        self._written: dict[int, bool] = {}

    def open(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> None:
        """Connect and write all coils."""
        self._written = {}
        self._link.connect()
        self._write(self._coils(reject, stop, permit, stations))

    def switch(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> None:
        """Write the coils that change."""
        wanted = self._coils(reject, stop, permit, stations)
        self._write({a: value for a, value in wanted.items() if self._written.get(a) != value})

    def refresh(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> bool | None:
        """Write all coils and the watchdog, and read the belt."""
        self._write(self._coils(reject, stop, permit, stations))
        wanted = self._parameters
        if wanted.watchdog >= 0:
            self._cycles = (self._cycles + 1) % 2**16
            self._link.write_register(wanted.watchdog, self._cycles)
        if wanted.belt < 0:
            return None
        return self._link.read_bits('discrete', wanted.belt, 1)[0] != wanted.belt_inverted

    def _coils(
        self, reject: bool, stop: bool, permit: bool, stations: Sequence[bool]
    ) -> dict[int, bool]:
        wanted = self._parameters
        coils = {wanted.reject: reject != wanted.reject_inverted}
        coils.update(zip(wanted.station_coils, stations, strict=True))
        if wanted.stop >= 0:
            coils[wanted.stop] = stop != wanted.stop_inverted
        if wanted.permit >= 0:
            coils[wanted.permit] = permit
        return coils

    def _write(self, coils: dict[int, bool]) -> None:
        for address, value in coils.items():
            self._link.write_coil(address, value)
            self._written[address] = value

    def close(self) -> None:
        """Close the connection."""
        self._link.close()


@dataclass(frozen=True)
class ModbusInputParameters(_DeviceParameters, InputParameters):
    """Which inputs the machine has, and how often they are read."""

    node: ClassVar[str] = 'modbus_inputs'

    host: str = parameter('localhost', 'name or address of the device')
    inputs: str = parameter('discrete', 'discrete inputs or coils', choices=('discrete', 'coil'))
    poll_period: float = parameter(
        0.005, 'time from one reading to the next; a reject has to last longer', unit='s',
        minimum=0, maximum=0.2,
    )  # fmt: skip
    delay: float = parameter(
        0.0, 'delay of an input by filter and cycle', unit='s', minimum=0, maximum=1
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        addresses = self.wiring().values()
        if not 0 <= min(addresses) <= max(addresses) <= _LAST_ADDRESS:
            raise ParameterError(f'modbus_inputs: addresses are 0..{_LAST_ADDRESS}')
        if max(addresses) - min(addresses) >= _MAX_INPUTS:
            raise ParameterError(
                f'modbus_inputs: {min(addresses)} to {max(addresses)} are more than {_MAX_INPUTS} '
                'inputs; one request cannot read all'
            )


class ModbusInputs(InputPort):
    """Inputs of the machine, polled in one request."""

    parameters = ModbusInputParameters

    def __init__(self, parameters: ModbusInputParameters) -> None:
        self._parameters = parameters
        self._wiring = parameters.wiring()
        self._link = parameters.link()
        self._next = time.monotonic()

    def open(self) -> None:
        """Connect."""
        self._link.connect()

    def read(self) -> list[Reading]:
        """Return what is read when the next reading is due."""
        time.sleep(max(0.0, self._next - time.monotonic()))
        self._next = time.monotonic() + self._parameters.poll_period
        first = min(self._wiring.values())
        begin, count = time.time_ns(), max(self._wiring.values()) - first + 1
        bits = self._link.read_bits(self._parameters.inputs, first, count)
        stamp = (begin + time.time_ns()) // 2 - round(self._parameters.delay * NANOSECONDS)
        levels = {
            name: bits[address - first] != self._parameters.is_inverted(name)
            for name, address in self._wiring.items()
        }
        return [Reading(stamp, levels)]

    def close(self) -> None:
        """Close the connection."""
        self._link.close()
