# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Machine inputs: rejects and readiness of inspection devices, guards, air pressure and bins.

The input of a metal detector, X-ray or vision inspection is on while the device rejects an item.
The input of a condition is on while the guards are closed, the air pressure suffices, the bins have
room or the inspection devices are ready. A broken wire of the input of a condition therefore stops
the line. The parameter `inverted` names the inputs with the opposite levels.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
import threading
import time
from typing import NamedTuple

from checkweigher_core.health.findings import Concern, Finding, Level, conclude, error_if
from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import NANOSECONDS, ExternalReject, MachineConditions
from checkweigher_core.records.reasons import StopReason
from checkweigher_driver.sources import RETRY_TIME

DEVICES = ('metal', 'xray', 'vision')
CONDITIONS = {
    'guards': StopReason.GUARD_OPEN,
    'air': StopReason.AIR_PRESSURE,
    'bins': StopReason.BIN_FULL,
    'inspections': StopReason.INSPECTION_FAULT,
}
_NONE = -1
_CLOSE_TIME = 3.0  # longest wait in s for the end of the thread
_input = partial(parameter, _NONE, minimum=_NONE)

InputEvent = ExternalReject | MachineConditions


@dataclass(frozen=True)
class InputParameters(Parameters):
    """Parameters of the machine inputs.

    The value of an input is its address (Modbus) or its line offset (GPIO).
    """

    metal: int = _input('input that is on while the metal detector rejects an item; -1 for none')
    xray: int = _input('input that is on while the X-ray inspection rejects an item; -1 for none')
    vision: int = _input('input that is on while the vision system rejects an item; -1 for none')
    guards: tuple[float, ...] = parameter((), 'inputs that are on while the guards are closed')
    air: tuple[float, ...] = parameter((), 'inputs that are on while the air pressure suffices')
    bins: tuple[float, ...] = parameter((), 'inputs that are on while the reject bins have room')
    inspections: tuple[float, ...] = parameter(
        (), 'inputs that are on while the inspection devices are ready'
    )
    inverted: str = parameter('', 'names of the inverted inputs, such as "metal bins"')
    bin_time: float = parameter(
        1.0,
        'time for which a bin input is off before the bin counts as full; products that fall past '
        'the sensor switch it off for a shorter time',
        unit='s',
        minimum=0,
        maximum=60,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.inverted.split():
            if name not in (*DEVICES, *CONDITIONS):
                known = ', '.join((*DEVICES, *CONDITIONS))
                raise ParameterError(f'{self.node}.inverted: {name!r} is not one of {known}')
        addresses = list(self.wiring().values())
        if not addresses:
            raise ParameterError(f'{self.node}: no input is given')
        if len(set(addresses)) < len(addresses):
            raise ParameterError(f'{self.node}: two inputs have the same address')

    def wiring(self) -> dict[str, int]:
        """Return the addresses of the connected inputs by name.

        The names of the inputs of a condition have an index, such as ``bins[0]``. The inputs of the
        inspection devices, such as ``metal``, have no index.
        """
        single = {name: int(getattr(self, name)) for name in DEVICES}
        several = {
            f'{name}[{number}]': int(address)
            for name in CONDITIONS
            for number, address in enumerate(getattr(self, name))
        }
        return {n: address for n, address in single.items() if address != _NONE} | several

    def is_inverted(self, name: str) -> bool:
        """Return whether the input `name` is inverted.

        All inputs of a condition, such as ``bins[0]`` and ``bins[1]``, are inverted together.
        """
        return name.partition('[')[0] in self.inverted.split()


class Reading(NamedTuple):
    """Levels of all inputs by name at time `stamp` in ns."""

    stamp: int
    levels: Mapping[str, bool]


class InputWatch:
    """Detector of new rejects and changed conditions in the readings of the inputs.

    A bin is reported as full when its input has been off for `bin_time` in s.
    """

    def __init__(self, bin_time: float) -> None:
        self._bin_time = round(bin_time * NANOSECONDS)
        self._on: set[str] = set()  # devices that reject an item at present
        self._off_since: dict[str, int] = {}  # stamps in ns at which inputs were switched off
        self._reported: MachineConditions | None = None
        self.rejects = 0

    def take(self, reading: Reading) -> list[InputEvent]:
        """Add a reading; return new external rejects, and the conditions if they have changed.

        The conditions are also returned for the first reading, and after they were unknown.
        """
        stamp, levels = reading
        on = {name for name in DEVICES if levels.get(name)}
        events: list[InputEvent] = [
            ExternalReject(stamp, name) for name in levels if name in on - self._on
        ]
        self._on = on
        self.rejects += len(events)
        wrong = self._wrong(reading)
        last = self._reported
        if last is None or not last.known or last.inputs != wrong:
            words = tuple(CONDITIONS[name.partition('[')[0]].value for name in wrong)
            self._reported = MachineConditions(stamp, True, words, wrong)
            events.append(self._reported)
        return events

    def _wrong(self, reading: Reading) -> tuple[str, ...]:
        stamp, levels = reading
        off = [name for name in levels if name not in DEVICES and not levels[name]]
        self._off_since = {name: self._off_since.get(name, stamp) for name in off}
        return tuple(
            name
            for name, since in self._off_since.items()
            if not name.startswith('bins') or stamp - since >= self._bin_time
        )

    def lose(self, stamp: int) -> list[InputEvent]:
        """Return an event with unknown conditions after a failed reading.

        Returns an empty list if the conditions were reported as unknown before.
        """
        if self._reported is not None and not self._reported.known:
            return []
        self._reported = MachineConditions(stamp, False)
        return [self._reported]

    @property
    def wrong(self) -> tuple[str, ...]:
        """Names of the inputs that require a stop, empty while the conditions are unknown."""
        return self._reported.inputs if self._reported else ()


class InputPort(ABC):
    """Device with the inputs of a machine. Only one thread uses it.

    `open` and `read` raise OSError or ValueError if the inputs cannot be read.
    """

    @abstractmethod
    def open(self) -> None:
        """Connect to the device."""

    @abstractmethod
    def read(self) -> list[Reading]:
        """Return one or more readings.

        The method may block until the next edge or poll, or until the timeout of the device.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""


class MachineInputs:
    """Inputs of a machine, which a thread reads from `open` to `close`.

    If `port` is None, the machine has no inputs. After an error, the thread opens the port again.
    """

    def __init__(self, port: InputPort | None, bin_time: float = 0.0) -> None:
        self.exist = port is not None  # whether the machine has inputs
        self._port = port
        self._watch = InputWatch(bin_time)
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self.trouble = ''  # reason why the inputs cannot be read, empty if they can be read

    def open(self, send: Callable[[InputEvent], None]) -> None:
        """Start the thread, which calls `send` with each new reject and with changed conditions.

        Nothing happens if the inputs are open already, or if the machine has no inputs.
        """
        if self._port is None or self._thread is not None:
            return
        self._closing.clear()
        self.trouble = 'the machine inputs have not been read yet'
        self._thread = threading.Thread(
            target=self._run, args=(self._port, send), name='inputs', daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop the thread, which closes the port, and wait for its end for at most 3 s."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(timeout=_CLOSE_TIME)
            self._thread = None
            self.trouble = ''

    def _run(self, port: InputPort, send: Callable[[InputEvent], None]) -> None:
        while not self._closing.is_set():
            try:
                port.open()
                while not self._closing.is_set():
                    for reading in port.read():
                        self.trouble = ''
                        for event in self._watch.take(reading):
                            send(event)
            except (OSError, ValueError) as error:
                self.trouble = f'the machine inputs cannot be read: {error}'
                for event in self._watch.lose(time.time_ns()):
                    send(event)
                port.close()
                self._closing.wait(RETRY_TIME)
        port.close()

    def finding(self) -> Finding:
        """Return the diagnostics finding of the inputs."""
        if not self.exist:
            return conclude('Machine inputs', 'none', [])
        wrong = {name: CONDITIONS[name.partition('[')[0]] for name in self._watch.wrong}
        concerns = (
            error_if(
                bool(self.trouble), self.trouble, 'check power, cable and address of the inputs'
            ),
            *(
                Concern(Level.ERROR, f'{reason.value}: input {name}', reason.hint)
                for name, reason in wrong.items()
            ),
        )
        return conclude(
            'Machine inputs',
            'no input requires a stop',
            concerns,
            {'external_rejects': self._watch.rejects},
        )
