# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Outputs of the machine, such as rejector and stop, which a thread switches."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import threading
import time

from checkweigher_core.health.findings import Finding, conclude, error_if
from checkweigher_core.records import NANOSECONDS, EyeEdge, Item, Permission, StopRequest, Verdict
from checkweigher_driver.line_io.belt_record import BeltRecord, record_path
from checkweigher_driver.line_io.rejector.switching import Levels, Switches
from checkweigher_driver.line_io.rejector_control import OutputParameters, RejectorControl
from checkweigher_driver.sources import RETRY_TIME, shorten_switch_interval

_CLOSE_TIME = 3.0  # longest wait in s for the end of the thread
_REFRESH_TIME = 5_000_000  # assumed longest duration of a refresh in ns


class OutputPort(ABC):
    """Device with the outputs and the belt input of a machine. Only one thread uses it.

    All methods except `close` raise OSError or ValueError if the device cannot be reached. `name`
    identifies the outputs, and is the same at each start. `permits` is true if the permit output is
    connected. `stations` is the number of sorting stations in addition to the rejector.
    """

    name: str
    permits: bool
    stations: int

    @abstractmethod
    def open(self, levels: Levels) -> None:
        """Connect to the device, and set all outputs."""

    @abstractmethod
    def switch(self, levels: Levels) -> None:
        """Set all outputs, and return when they are set."""

    @abstractmethod
    def refresh(self, levels: Levels) -> bool | None:
        """Set all outputs, and send a heartbeat.

        Return whether the belt runs, or None without a belt input.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""


class MachineOutputs:
    """Outputs that reject items at the times in their verdicts, and stop the line.

    In the safe state the rejector has the state of the parameter `safe_state`, and the stop output
    is set. The outputs are in the safe state from `open` until `activate`, and after `safe` or
    `close`. The stop output is also set during a fault, or without a fresh permission to run. The
    stop output is also set if the rejector may have missed a product, or if the previous run may
    have left items on the belt. A stop because of missed products or items of the previous run
    holds until `reset` is called, or until a person resets a stop request that shows all messages
    on them.

    A thread opens the port, and opens it again after an error. If `port` is None, the machine has
    no outputs.
    """

    def __init__(self, port: OutputPort | None, parameters: OutputParameters) -> None:
        self.exist = port is not None  # whether the machine has outputs
        self._port = port
        self._parameters = parameters
        self._changed = threading.Condition()
        self._control = RejectorControl(parameters)
        self._port_trouble = ''  # reason why the port cannot be used, empty if it can be used
        self._thread: threading.Thread | None = None
        self.is_open = False

    @contextmanager
    def _change(self) -> Iterator[RejectorControl]:
        with self._changed:
            yield self._control
            self._changed.notify_all()

    @property
    def ready(self) -> bool:
        """Whether the outputs can be switched.

        The property is also true before `open`, and if the machine has no outputs.
        """
        return not self._port_trouble

    def trouble_with(self, source: str) -> str:
        """Return the one-line text of a new stop request, or '' if no new request is needed.

        `source` is the present fault of the source or the inputs, or ''. The text contains each
        fault and all missed products, because it replaces the text of the previous stop request.
        """
        with self._changed:
            missed = self._control.missed
            if not missed.pending and not (source or self._port_trouble):
                return ''
            return '; '.join(filter(None, (source, self._port_trouble, missed.text)))

    def finding(self) -> Finding:
        """Return the diagnostics finding of the outputs."""
        if not self.is_open:
            return conclude('Outputs', 'not open' if self.exist else 'none', [])
        port, missed = self._port_trouble, self._control.missed.text
        check = 'check power, cable and address of the outputs; then reset the stop'
        concerns = (
            error_if(bool(port), port, check),
            error_if(bool(missed), missed, 'look for the product; then reset the stop'),
        )
        values: dict[str, float | str] = {
            **{name.replace(' ', '_'): value for name, value in self._control.figures.items()},
            'belt_runs': {None: 'unknown', True: 'yes', False: 'no'}[self._control.motion.measured],
        }
        return conclude('Outputs', 'switched in time', concerns, values)

    def activate(self) -> None:
        """Leave the safe state."""
        with self._change() as control:
            control.active = True

    def safe(self) -> None:
        """Enter the safe state, and cancel all pulses and permits.

        Items on the belt are reported as missed, which stops the line until a person has looked for
        them.
        """
        with self._change() as control:
            control.make_safe()

    def take(self, record: EyeEdge | Item | Verdict | Permission | StopRequest | None) -> None:
        """Update the outputs after an edge, an item, a verdict, a permission or a stop request.

        If `record` is None, the stop request was reset. Edges, items and verdicts are ignored
        before `open` and after `close`.
        """
        now = time.monotonic_ns()
        with self._change() as control:
            match record:
                case Permission():
                    control.run_permission.take_permission(record, now)
                case StopRequest() | None:
                    control.run_permission.take_request(record)
                case _ if not self.is_open:
                    pass
                case EyeEdge():
                    control.edge(record, now)
                case Item():
                    control.announce(record)
                case Verdict():
                    control.verdict(record, now)

    def reset(self) -> str:
        """Release the stop after missed products; return the messages on them in one line.

        The result is empty if no product was missed.
        """
        with self._change() as control:
            missed = control.missed.text
            control.missed.clear()
            return missed

    def open(self, held: Callable[[], bool] = lambda: False) -> None:
        """Start the thread that opens and switches the outputs.

        The thread calls `held` in each cycle. `held` returns whether the line has to stop because
        of a fault of the source or the inputs. Nothing happens if the outputs are open already or
        if the machine has no outputs. Raises `ParameterError` if the file with the state of the
        belt cannot be used.
        """
        if self._port is None or self.is_open:
            return
        if self._thread is not None:
            self._thread.join()  # the previous thread may still be waiting for the device
        port, wanted = self._port, self._parameters
        record = BeltRecord(record_path(wanted.record, port.name))
        self._control = RejectorControl(wanted, permits=port.permits, stations=port.stations)
        for text in record.found.to_look_for():
            self._control.missed.add(text)
        self._port_trouble, self.is_open = 'the outputs are not connected yet', True
        shorten_switch_interval()
        self._thread = threading.Thread(
            target=self._run, args=(port, record, held), name='outputs', daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Enter the safe state, and end the thread, which closes the port.

        Items on the belt are reported as missed. The method waits for the end of the thread, but
        for at most 3 s.
        """
        if self._thread is not None and self.is_open:
            with self._change() as control:
                control.make_safe()
                self.is_open = False
            self._thread.join(timeout=_CLOSE_TIME)

    def _run(self, port: OutputPort, record: BeltRecord, held: Callable[[], bool]) -> None:
        """Open the port and switch the outputs until `close`; after an error, begin again.

        At the end, the state of the belt is recorded for the next start.
        """
        safe = self._control.safe_levels
        while self.is_open:
            try:
                # The safe state is written first, because the device may have kept older levels.
                port.open(safe)
                self._serve(port, record, held)
                port.switch(safe)
            except Exception as error:  # any failure of the port has to stop the line
                with self._changed:
                    self._control.disconnect()
                    self._port_trouble = f'the outputs cannot be reached: {error}'
                port.close()
                with self._changed:
                    self._changed.wait_for(lambda: not self.is_open, RETRY_TIME)
        port.close()
        record.close(self._control.on_belt())

    def _serve(self, port: OutputPort, record: BeltRecord, held: Callable[[], bool]) -> None:
        """Switch and refresh the outputs until `close`."""
        cycle = round(self._parameters.cycle * NANOSECONDS)
        written: Levels | None = None
        next_refresh, dues = time.monotonic_ns(), Switches()
        with self._changed:
            self._control.connect(next_refresh)
            self._port_trouble = ''
        while True:
            with self._changed:
                if not self.is_open:
                    return
                now = time.monotonic_ns()
                were_due, wanted = dues, self._control.levels(now)
                dues = self._control.next_switches(now)
                next_event = min(dues)
                # Postpone a refresh that would delay an output that is due within 5 ms.
                if next_event - next_refresh >= _REFRESH_TIME:
                    next_event = next_refresh
                if wanted == written and now < next_event:
                    self._changed.wait((next_event - now) / NANOSECONDS)
                    continue
                on_belt = self._control.on_belt()
            record.keep(on_belt)  # the belt may run only when its record is on the disk
            if wanted != written:
                port.switch(wanted)
                done = time.monotonic_ns()
                if written:
                    with self._changed:
                        self._control.switched(written, wanted, were_due, now, done)
                written = wanted
            if now >= next_refresh:
                running, must_stop = port.refresh(wanted), held()
                with self._changed:
                    self._control.held = must_stop
                    done = time.monotonic_ns()
                    self._control.belt(running, done)
                    self._control.alive(now, done)
                next_refresh = max(next_refresh + cycle, time.monotonic_ns())
