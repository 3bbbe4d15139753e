# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Inputs of the machine: inspection devices that reject, guards, air, bins.

A metal detector, X-ray or vision input is on while its device rejects; its edge is an external
reject of the item that is there. The other inputs are on while all is well, so that a dead wire
stops the line: guards closed, enough air, room in the bins, inspection devices ready.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
import threading
import time
from typing import NamedTuple

from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import NANOSECONDS, ExternalReject, MachineConditions
from checkweigher_core.records.reasons import StopReason

DEVICES = ('metal', 'xray', 'vision')
CONDITIONS = {
    'guards': StopReason.GUARD_OPEN,
    'air': StopReason.AIR_PRESSURE,
    'bins': StopReason.BIN_FULL,
    'inspections': StopReason.INSPECTION_FAULT,
}
_NONE = -1
_FIRST_BACKOFF, _LONGEST_BACKOFF = 0.1, 2.0  # s
_CLOSE_TIME = 3.0  # s

Levels = Mapping[str, bool]  # by the names of the inputs
Said = ExternalReject | MachineConditions


@dataclass(frozen=True)
class InputParameters(Parameters):
    """Which inputs there are, by address or offset; the devices add where they are."""

    metal: int = parameter(
        _NONE, 'input that is on while the metal detector rejects; -1 for none', minimum=_NONE
    )
    xray: int = parameter(
        _NONE, 'input that is on while the X-ray inspection rejects; -1 for none', minimum=_NONE
    )
    vision: int = parameter(
        _NONE, 'input that is on while the vision inspection rejects; -1 for none', minimum=_NONE
    )
    guards: tuple[float, ...] = parameter((), 'inputs that are on while guards are closed')
    air: tuple[float, ...] = parameter((), 'inputs that are on while there is enough air')
    bins: tuple[float, ...] = parameter((), 'inputs that are on while reject bins have room')
    inspections: tuple[float, ...] = parameter(
        (), 'inputs that are on while inspection devices are ready'
    )
    inverted: str = parameter('', 'inputs that are inverted, such as "metal bins"')
    bin_time: float = parameter(
        1.0, 'time for which a bin has no room before it counts as full: products fall past',
        unit='s', minimum=0, maximum=60,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.inverted.split():
            if name not in (*DEVICES, *CONDITIONS):
                known = ', '.join((*DEVICES, *CONDITIONS))
                raise ParameterError(f'{self.node}.inverted: {name!r} is not one of {known}')
        addresses = list(self.wiring().values())
        if not addresses:
            raise ParameterError(f'{self.node}: names no input')
        if len(set(addresses)) < len(addresses):
            raise ParameterError(f'{self.node}: two inputs have one address')

    def wiring(self) -> dict[str, int]:
        """Return the address of each input by its name."""
        single = {name: int(getattr(self, name)) for name in DEVICES}
        found = {name: address for name, address in single.items() if address != _NONE}
        for name in CONDITIONS:
            for number, address in enumerate(getattr(self, name)):
                found[f'{name}[{number}]'] = int(address)
        return found

    def is_inverted(self, name: str) -> bool:
        """Tell whether an input is the other way round."""
        return name.partition('[')[0] in self.inverted.split()


class Reading(NamedTuple):
    """The levels of all inputs, as they are from `stamp` on, ns."""

    stamp: int
    levels: Levels


class InputWatch:
    """What the inputs say, from one reading to the next."""

    def __init__(self, names: Iterable[str], bin_time: float) -> None:
        self._names = tuple(names)
        self._bin_time = round(bin_time * NANOSECONDS)
        self._on: set[str] = set()  # devices that reject
        self._off_since: dict[str, int] = {}  # of conditions
        self._said: MachineConditions | None = None
        self.rejects = 0

    def take(self, reading: Reading) -> list[Said]:
        """Take a reading and return what is new in it."""
        said: list[Said] = []
        for name in self._names:
            if name not in DEVICES:
                self._follow(name, reading)
            elif not reading.levels[name]:
                self._on.discard(name)
            elif name not in self._on:
                self._on.add(name)
                self.rejects += 1
                said.append(ExternalReject(reading.stamp, name))
        return said + self._conditions(reading.stamp)

    def _follow(self, name: str, reading: Reading) -> None:
        if reading.levels[name]:
            self._off_since.pop(name, None)
        else:
            self._off_since.setdefault(name, reading.stamp)

    def _conditions(self, stamp: int) -> list[Said]:
        wrong = [name for name in self._names if self._is_wrong(name, stamp)]
        words = tuple(CONDITIONS[name.partition('[')[0]].value for name in wrong)
        now = MachineConditions(stamp, True, words, tuple(wrong))
        last = self._said
        if last is not None and last.known and last.inputs == now.inputs:
            return []
        self._said = now
        return [now]

    def _is_wrong(self, name: str, stamp: int) -> bool:
        since = self._off_since.get(name)
        if since is None:
            return False
        return not name.startswith('bins') or stamp - since >= self._bin_time

    def lose(self, stamp: int) -> list[Said]:
        """Note that the inputs cannot be read, from `stamp` on."""
        if self._said is not None and not self._said.known:
            return []
        self._said = MachineConditions(stamp, False)
        return [self._said]

    @property
    def wrong(self) -> tuple[str, ...]:
        """The inputs that show that something is wrong."""
        return self._said.inputs if self._said else ()


class InputPort(ABC):
    """The inputs of a machine. Only one thread uses it.

    `open` and `read` raise OSError or ValueError if they cannot be read.
    """

    @abstractmethod
    def open(self) -> None:
        """Connect."""

    @abstractmethod
    def read(self) -> list[Reading]:
        """Wait for the next readings, at most some tenths of a second."""

    @abstractmethod
    def close(self) -> None:
        """Close what is open."""


class MachineInputs:
    """Inputs that a thread of this object reads from `open` to `close`, again after a loss.

    `send` is called in that thread with what they say. A `port` of None is that of a machine
    without inputs, which then are never in trouble.
    """

    def __init__(self, port: InputPort | None, parameters: InputParameters | None = None) -> None:
        self._port = port
        names = parameters.wiring() if parameters else {}
        self._watch = InputWatch(names, parameters.bin_time if parameters else 0.0)
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._trouble = ''

    @property
    def exist(self) -> bool:
        """Whether the machine has inputs."""
        return self._port is not None

    @property
    def trouble(self) -> str:
        """One line while they are not read, else empty."""
        return self._trouble

    def open(self, send: Callable[[Said], None]) -> None:
        """Begin to read; a device that is not there is waited for."""
        if self._port is None or self._thread is not None:
            return
        self._closing.clear()
        self._trouble = 'the machine inputs have not been read yet'
        self._thread = threading.Thread(
            target=self._run, args=(self._port, send), name='inputs', daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop reading."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(timeout=_CLOSE_TIME)
            self._thread = None
            self._trouble = ''

    def _run(self, port: InputPort, send: Callable[[Said], None]) -> None:
        backoff = _FIRST_BACKOFF
        while not self._closing.is_set():
            try:
                port.open()
                while not self._closing.is_set():
                    for reading in port.read():
                        self._trouble = ''
                        backoff = _FIRST_BACKOFF
                        for said in self._watch.take(reading):
                            send(said)
            except (OSError, ValueError) as error:
                self._trouble = f'the machine inputs are not read: {error}'
                for said in self._watch.lose(time.time_ns()):
                    send(said)
                port.close()
                self._closing.wait(backoff)
                backoff = min(2 * backoff, _LONGEST_BACKOFF)
        port.close()

    def finding(self) -> Finding:
        """Return the aspect Machine inputs of the diagnostics."""
        if not self.exist:
            return conclude('Machine inputs', 'none', [])
        found = []
        if self._trouble:
            hint = 'check power, cable and address of the inputs'
            found.append(Concern(Level.ERROR, self._trouble, hint))
        for name in self._watch.wrong:
            reason = CONDITIONS[name.partition('[')[0]]
            found.append(Concern(Level.ERROR, f'{reason.value}: input {name}', reason.hint))
        return conclude(
            'Machine inputs', 'all is well', found, {'external_rejects': self._watch.rejects}
        )
