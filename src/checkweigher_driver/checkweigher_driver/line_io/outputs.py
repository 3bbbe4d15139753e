# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rejector and stop output of the line, switched by a thread at the time they are due."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import threading
import time

from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.records import (
    NANOSECONDS,
    EyeEdge,
    Item,
    Permission,
    StopRequest,
    Verdict,
)
from checkweigher_driver.line_io.belt_record import BeltRecord, record_path
from checkweigher_driver.line_io.missed_products import Latch, LatchEvent
from checkweigher_driver.line_io.rejector_control import (
    Levels,
    OutputParameters,
    RejectorControl,
    Switches,
)
from checkweigher_driver.prompt_threads import shorten_switch_interval

_FIRST_BACKOFF, _LONGEST_BACKOFF = 0.1, 2.0  # s
_CLOSE_TIME = 3.0  # s
_REFRESH_TIME = 5_000_000  # ns without a refresh before the rejector is due


class OutputPort(ABC):
    """The outputs and the belt input of a machine. Only one thread uses it.

    All methods but `close` raise OSError or ValueError if the port cannot be reached. `name` is
    that of these outputs, the same at each start; `permits` tells whether the permit is wired,
    `stations` how many stations beside the rejector are.
    """

    name: str
    permits: bool
    stations: int

    @abstractmethod
    def open(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> None:
        """Connect and set all outputs."""

    @abstractmethod
    def switch(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> None:
        """Set all outputs, and return when they are set."""

    @abstractmethod
    def refresh(
        self, *, reject: bool, stop: bool, permit: bool = False, stations: Sequence[bool] = ()
    ) -> bool | None:
        """Write all outputs with a sign of life; return whether the belt runs.

        None without a belt input.
        """

    @abstractmethod
    def close(self) -> None:
        """Close what is open."""


class MachineOutputs:
    """Reject at the time that a verdict names, and stop the line when it has to.

    The outputs are safe from `open` until `activate`, and after `safe` or `close`: the rejector in
    its safe state, the stop output set. The stop output is set without a fresh permission to run. A
    rejected product that the rejector can have missed sets it as well,
    until a stop request that showed the product is taken back, or `reset`; so does what a run
    before this one has left on the belt, by the record that each keeps.

    The thread of this object opens the port, again when it is lost. A `port` of None is that of a
    machine without outputs, which then are never open, and never in trouble.
    """

    def __init__(self, port: OutputPort | None, parameters: OutputParameters) -> None:
        self._port = port
        self._parameters = parameters
        self._changed = threading.Condition()
        self._control = RejectorControl(parameters)
        self._port_trouble = ''
        self._written: Levels | None = None
        self._held: Callable[[], bool] = lambda: False
        self._closed = True
        self._thread: threading.Thread | None = None

    @contextmanager
    def _change(self) -> Iterator[RejectorControl]:
        with self._changed:
            yield self._control
            self._changed.notify_all()

    @property
    def exist(self) -> bool:
        """Whether the machine has outputs."""
        return self._port is not None

    @property
    def trouble(self) -> str:
        """One line while the outputs do not do their work or a product was missed, else empty."""
        with self._changed:
            return self._port_trouble or self._control.missed.text

    @property
    def belt_runs(self) -> bool | None:
        """Whether the belt runs, None where no input says so."""
        with self._changed:
            return self._control.belt_runs

    @property
    def ready(self) -> bool:
        """Whether they can be switched, if there are any."""
        with self._changed:
            return not self._port_trouble

    def trouble_with(self, source: str) -> str:
        """Return what the line does not know yet or what still is wrong, in one line, else empty.

        `source` is the trouble of load cell and photo-eyes. A product that is missed while
        something else is wrong is told for as long as that: the stop request shows what it was
        told last, and has to show it still when only that remains.
        """
        with self._changed:
            missed = self._control.missed
            if missed.state is not Latch.UNTOLD and not (source or self._port_trouble):
                return ''
            return '; '.join(filter(None, (source, self._port_trouble, missed.text)))

    def figures(self) -> dict[str, float]:
        """Return what /diagnostics shows."""
        with self._changed:
            return {**self._control.figures.shown(), 'clock steps': self._control.clock.steps}

    def finding(self) -> Finding:
        """Return the aspect Outputs of the diagnostics."""
        if self._closed:
            return conclude('Outputs', 'not open' if self.exist else 'none', [])
        with self._changed:
            port, missed = self._port_trouble, self._control.missed.text
        found = []
        if port:
            hint = 'check power, cable and address of the outputs; then call reset_stop_request'
            found.append(Concern(Level.ERROR, port, hint))
        elif missed:
            hint = 'look for the product; then call reset_stop_request'
            found.append(Concern(Level.ERROR, missed, hint))
        belt = {None: 'unknown', True: 'yes', False: 'no'}[self.belt_runs]
        values: dict[str, float | str] = {
            name.replace(' ', '_'): value for name, value in self.figures().items()
        }
        return conclude('Outputs', 'switched as told', found, {**values, 'belt_runs': belt})

    def activate(self) -> None:
        """Leave the safe state."""
        with self._change() as control:
            control.active = True

    def safe(self) -> None:
        """Take the safe state, and forget all pulses."""
        with self._change() as control:
            control.make_safe()

    def take_permission(self, permission: Permission) -> None:
        """Process a permission of reject."""
        with self._change() as control:
            control.take_permission(permission, time.monotonic_ns())

    def take_request(self, request: StopRequest | None) -> None:
        """Process a stop request, None if it says that the line may run."""
        with self._change() as control:
            control.take_request(request)

    def reset(self) -> str:
        """Let the line run again after a product that can have been missed; return which."""
        with self._change() as control:
            missed = control.missed.text
            control.missed.take(LatchEvent.RESET)
            return missed

    def edge(self, edge: EyeEdge) -> None:
        """Take an edge that was published."""
        with self._changed:
            if not self._closed:
                self._control.edge(edge, time.monotonic_ns())

    def announce(self, item: Item) -> None:
        """Add the number of an item that the segmenter has announced."""
        with self._changed:
            if not self._closed:
                self._control.announce(item)

    def verdict(self, verdict: Verdict) -> None:
        """Take a verdict; of one that accepts, only that it has come matters."""
        with self._change() as control:
            if not self._closed:
                control.verdict(verdict, time.monotonic_ns())

    def open(self, held: Callable[[], bool] = lambda: False) -> None:
        """Connect, safe until `activate`; a device that is not there is waited for.

        `held` is asked each cycle, in the thread of the outputs: whether the line has to stop
        because its load cell or photo-eyes do not work. `ParameterError` if there can be no record
        of what is on the belt.
        """
        if not self._closed or self._port is None:
            return
        if self._thread is not None:
            self._thread.join()  # its last request may still wait for an answer
        record = BeltRecord(record_path(self._parameters.record, self._port.name))
        self._control = RejectorControl(
            self._parameters, permits=self._port.permits, stations=self._port.stations
        )
        for text in record.found.to_look_for():
            self._control.missed.add(text)
        self._port_trouble = 'the outputs are not connected yet'
        self._written = None
        self._held = held
        self._closed = False
        shorten_switch_interval()
        self._thread = threading.Thread(
            target=self._run, args=(self._port, record), name='outputs', daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Take the safe state and disconnect."""
        if self._closed or self._thread is None:
            return
        with self._change() as control:
            control.make_safe()
            self._closed = True
        self._thread.join(timeout=_CLOSE_TIME)

    def _run(self, port: OutputPort, record: BeltRecord) -> None:
        """Connect, serve, and connect again after a loss, until the outputs are closed."""
        backoff, safe = _FIRST_BACKOFF, self._control.safe_levels
        while not self._closed:
            try:
                # The device may have kept what was written before: first the safe state.
                port.open(**safe._asdict())
                backoff = _FIRST_BACKOFF
                self._serve(port, record)
                port.switch(**safe._asdict())
            except Exception as error:  # every failure of the port must be told to the line
                with self._changed:
                    self._control.disconnect()
                    self._written = None
                    self._port_trouble = f'the rejector is not reached: {error}'
                port.close()
                with self._changed:
                    self._changed.wait_for(lambda: self._closed, timeout=backoff)
                backoff = min(2 * backoff, _LONGEST_BACKOFF)
        port.close()
        record.close(self._control.on_belt())

    def _serve(self, port: OutputPort, record: BeltRecord) -> None:
        """Switch and refresh until the outputs are closed."""
        next_refresh = time.monotonic_ns()
        cycle = round(self._parameters.cycle * NANOSECONDS)
        dues = Switches(None, None)
        with self._changed:
            self._control.connect(next_refresh)
            self._port_trouble = ''
        while True:
            with self._changed:
                if self._closed:
                    return
                now = time.monotonic_ns()
                self._control.clock.look()
                were_due, wanted = dues, self._control.levels(now)
                dues = self._control.next_switches(now)
                due = min((each for each in dues if each is not None), default=None)
                # A refresh must not be under way when the rejector is due.
                soon = due is not None and due - next_refresh < _REFRESH_TIME
                next_event = due if due is not None and soon else next_refresh
                if wanted == self._written and now < next_event:
                    self._changed.wait((next_event - now) / NANOSECONDS)
                    continue
                on_belt = self._control.on_belt()
            record.keep(on_belt)  # that the belt may run, before it does
            if wanted != self._written:
                self._switch(port, wanted, were_due, now)
            if now >= next_refresh:
                running, held = port.refresh(**wanted._asdict()), self._held()
                with self._changed:
                    self._control.held = held
                    done = time.monotonic_ns()
                    self._control.belt(running, done)
                    self._control.alive(now, done)
                next_refresh = max(next_refresh + cycle, time.monotonic_ns())

    def _switch(self, port: OutputPort, wanted: Levels, due: Switches, begun: int) -> None:
        port.switch(**wanted._asdict())
        done = time.monotonic_ns()
        with self._changed:
            before, self._written = self._written, wanted
            if before:
                self._control.switched(before, wanted, due, begun, done)
