"""What the line is told: rejector and stop, switched by a thread at the time they are due."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
import threading
import time
from typing import ClassVar

from checkweigher_driver.line_io.answer_watch import AnswerWatch
from checkweigher_driver.line_io.clock_watch import ClockWatch
from checkweigher_driver.line_io.reject_pulses import RejectPulses
from checkweigher_driver.prompt_threads import be_prompt
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import NANOSECONDS, Decision, EyeEdge, Verdict

_FIRST_BACKOFF, _LONGEST_BACKOFF = 0.1, 2.0  # s
# A reject time further ahead is not on the clock of this machine.
_FURTHEST = 600 * NANOSECONDS
_CLOCK_STEP = 5_000_000  # ns
_CLOSE_TIME = 3.0  # s
_MAX_MISSED = 3  # that are told of
# The speed by the eyes may then be that of a belt that stood for a while.
_SPEED_IN_DOUBT = {Reason.BELT_STOPPED.value, Reason.BELT_SPEED_CHANGED.value}
_REFRESH_TIME = 5_000_000  # ns, that is kept free of it before the rejector is due


@dataclass(frozen=True)
class OutputParameters(Parameters):
    """How rejector and stop are switched."""

    node: ClassVar[str] = 'rejector'

    pulse: float = parameter(
        0.1, 'how long the rejector acts for one product', unit='s', minimum=0.001, maximum=60
    )
    min_pause: float = parameter(
        0.02, 'shortest pause of the rejector; pulses that are closer become one', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    late_tolerance: float = parameter(
        0.01, 'a rejected product whose pulse begins later may have passed: stop', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    belt_margin: float = parameter(
        0.05, 'by which a pulse is longer at both ends if the belt stopped before it', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    verdict_timeout: float = parameter(
        0.0, 'from a product at the outfeed eye to the next verdict, at most: else eject and stop; '
        '0: the time to the rejector of the product before', unit='s', minimum=0, maximum=60,
    )  # fmt: skip
    safe_state: str = parameter(
        'eject', 'what the rejector does while nobody decides', choices=('eject', 'retract')
    )
    cycle: float = parameter(
        0.05, 'period in which all outputs are written anew and the belt input is read', unit='s',
        minimum=0.005, maximum=10,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_pause > 10 * self.pulse:
            raise ParameterError(
                f'rejector.min_pause: {self.min_pause:g} s is more than ten pulses of '
                f'{self.pulse:g} s'
            )


class PortLostError(ValueError):
    """The outputs cannot be reached; one line that says which and why."""


class OutputPort(ABC):
    """The two outputs and the belt input of a machine. Only one thread uses it."""

    @abstractmethod
    def open(self, *, reject: bool, stop: bool) -> None:
        """Connect and set both outputs; `PortLostError` if that fails."""

    @abstractmethod
    def switch(self, *, reject: bool, stop: bool) -> None:
        """Set both outputs, and return when they are set; `PortLostError` if that fails."""

    @abstractmethod
    def refresh(self, *, reject: bool, stop: bool) -> bool | None:
        """Write all outputs anew with a sign of life; return whether the belt runs.

        None without a belt input. `PortLostError` if it fails.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of what is open."""


class MachineOutputs:
    """Reject at the time that a verdict names, and stop the line when it has to.

    The outputs are safe from the beginning, until `activate`, and after `safe` or `close`: the
    rejector in its safe state, the stop output set. It stays set until `stop_request` has said that
    the line may run. A rejected product that the rejector can have missed sets it as well, until
    `reset`.

    Parameters
    ----------
    port : OutputPort
        Opened, and opened again when it is lost, by the thread of this object.
    parameters : OutputParameters
        Times and the safe state.
    """

    def __init__(self, port: OutputPort, parameters: OutputParameters) -> None:
        self._port = port
        self._parameters = parameters
        self._pulses = RejectPulses(
            *(
                round(value * NANOSECONDS)
                for value in (
                    parameters.pulse, parameters.min_pause, parameters.late_tolerance,
                    parameters.belt_margin,
                )
            )
        )  # fmt: skip
        self._changed = threading.Condition()
        self._clock = ClockWatch(_CLOCK_STEP)
        self._active = self._closing = self._connected = False
        self._stop_requested = True  # until somebody says that the line may run
        self._port_trouble = 'the outputs are not connected yet'
        self._held = False
        self._missed: list[str] = []
        self._answers = AnswerWatch(round(parameters.verdict_timeout * NANOSECONDS))
        self._belt: bool | None = None
        self._written: tuple[bool, bool] | None = None
        self._due: int | None = None  # when the rejector switches next
        self._figures = _Figures()
        be_prompt()
        self._thread = threading.Thread(target=self._run, name='outputs', daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> str:
        """One line while the outputs do not do their work or a product was missed, else empty."""
        with self._changed:
            return self._port_trouble or '; '.join(self._missed)

    @property
    def port_trouble(self) -> str:
        """One line while the outputs cannot be switched, else empty."""
        with self._changed:
            return self._port_trouble

    @property
    def missed(self) -> str:
        """What the rejector can have missed since the last reset, else empty."""
        with self._changed:
            return '; '.join(self._missed)

    @property
    def belt_runs(self) -> bool | None:
        """Whether the belt runs, None where no input says so."""
        with self._changed:
            return self._belt

    def figures(self) -> dict[str, float]:
        """Return what /diagnostics shows.

        ``switch error ms`` is how far the rejector was switched from when it was due, as far as its
        device said so, the largest one beside the mean; positive is late.
        """
        with self._changed:
            return {**self._figures.shown(), 'clock steps': self._clock.steps}

    def activate(self) -> None:
        """Leave the safe state."""
        with self._changed:
            self._active = True
            self._changed.notify_all()

    def safe(self) -> None:
        """Take the safe state, and forget what was to come."""
        with self._changed:
            self._active = False
            self._answers.clear()
            self._pulses.clear()
            self._changed.notify_all()

    def stop_request(self, stop: bool) -> None:
        """Ask the line to stop, or no longer."""
        with self._changed:
            self._stop_requested = stop
            self._changed.notify_all()

    def hold(self, stop: bool) -> None:
        """Stop the line while its load cell or photo-eyes do not work, whoever says it may run."""
        with self._changed:
            if stop != self._held:
                self._held = stop
                self._changed.notify_all()

    def reset(self) -> None:
        """Allow the line to run again after somebody has looked for a missed product."""
        with self._changed:
            self._missed.clear()
            self._changed.notify_all()

    def edge(self, edge: EyeEdge) -> None:
        """Take an edge of the photo-eyes: a product that leaves the belt must have its verdict."""
        with self._changed:
            self._answers.edge(edge, time.monotonic_ns())

    def verdict(self, verdict: Verdict) -> None:
        """Take a verdict; of those that accept only that they come matters."""
        with self._changed:
            self._answers.verdict(verdict)
        if verdict.decision == Decision.ACCEPT:
            return
        with self._changed:
            self._figures.rejects += 1
            if not self._active:
                if self._parameters.safe_state != 'eject':
                    self._miss(f'item {verdict.item_id}: the rejector was not active; look for it')
                return
            now, to_monotonic = time.monotonic_ns(), self._clock.look()
            due = since = entered = None
            in_doubt = self._belt is None and not _SPEED_IN_DOUBT.isdisjoint(verdict.reasons)
            if verdict.reject_at is not None and to_monotonic is not None and not in_doubt:
                due = verdict.reject_at + to_monotonic
                since = None if verdict.t3 is None else verdict.t3 + to_monotonic
                entered = None if verdict.t1 is None else verdict.t1 + to_monotonic
                if due - now > _FURTHEST:
                    due = None
            late = self._pulses.add(due, since, now, entered)
            if late is None:
                self._miss(f'item {verdict.item_id}: nobody knows when it is at the rejector')
            elif late:
                self._figures.late_rejects += 1
                self._miss(
                    f'item {verdict.item_id}: its verdict came {1e-6 * late:.0f} ms after its '
                    'reject time; look for it behind the rejector'
                )
            elif not self._connected:
                self._miss(
                    f'item {verdict.item_id}: the rejector could not be reached; look for it '
                    'behind the rejector'
                )
            self._changed.notify_all()

    def close(self) -> None:
        """Take the safe state and let go of the outputs."""
        with self._changed:
            self._active = False
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout=_CLOSE_TIME)

    def _miss(self, text: str) -> None:
        if text not in self._missed and len(self._missed) < _MAX_MISSED:
            self._missed.append(text)

    def _wanted(self, now: int) -> tuple[bool, bool]:
        """Return what rejector and stop are to be."""
        if not self._active:
            return self._parameters.safe_state == 'eject', True
        self._check_answer(now)
        skipped = self._pulses.skipped
        acting = self._pulses.acting(now)
        if self._pulses.skipped > skipped:
            self._miss('the machine was too busy to switch the rejector; look behind it')
        return acting, self._stop_requested or self._held or bool(self._missed)

    def _check_answer(self, now: int) -> None:
        """Eject and stop if no verdict comes: whoever gives them hangs."""
        if self._answers.is_overdue(now):
            timeout = self._answers.timeout / NANOSECONDS
            self._pulses.add(None, None, now)
            self._miss(
                f'a product left the belt and no verdict came within {timeout:.2g} s; check that '
                'reject runs, and look behind the rejector'
            )

    def _run(self) -> None:
        backoff, safe = _FIRST_BACKOFF, self._parameters.safe_state == 'eject'
        while not self._closing:
            try:
                # Whatever the other side kept of the time before: first the safe state.
                self._port.open(reject=safe, stop=True)
                backoff = _FIRST_BACKOFF
                self._serve()
                self._port.switch(reject=safe, stop=True)
            except Exception as error:  # whatever breaks the port, the line must hear of it
                self._lose(str(error))
                self._port.close()
                with self._changed:
                    self._changed.wait_for(lambda: self._closing, timeout=backoff)
                backoff = min(2 * backoff, _LONGEST_BACKOFF)
        self._port.close()

    def _lose(self, text: str) -> None:
        with self._changed:
            if self._connected:
                self._figures.losses += 1
            self._connected = False
            self._belt = self._written = None
            self._port_trouble = text

    def _serve(self) -> None:
        """Switch and refresh until this object is closed."""
        next_refresh = time.monotonic_ns()
        with self._changed:
            if self._pulses.begun(time.monotonic_ns()):
                self._miss('the rejector could not be reached when it should act; look behind it')
            self._connected = True
            self._port_trouble = ''
        while True:
            with self._changed:
                if self._closing:
                    return
                now = time.monotonic_ns()
                self._clock.look()
                due, wanted = self._due, self._wanted(now)
                self._due = self._pulses.next_change(now) if self._active else None
                # A refresh must not be under way when the rejector is due.
                soon = self._due is not None and self._due - next_refresh < _REFRESH_TIME
                next_event = self._due if self._due is not None and soon else next_refresh
                if wanted == self._written and now < next_event:
                    self._changed.wait((next_event - now) / NANOSECONDS)
                    continue
            if wanted != self._written:
                self._switch(wanted, due, now)
            if now >= next_refresh:
                self._see_belt(self._port.refresh(reject=wanted[0], stop=wanted[1]))
                cycle = round(self._parameters.cycle * NANOSECONDS)
                next_refresh = max(next_refresh + cycle, time.monotonic_ns())

    def _switch(self, wanted: tuple[bool, bool], due: int | None, begun: int) -> None:
        self._port.switch(reject=wanted[0], stop=wanted[1])
        done = time.monotonic_ns()
        with self._changed:
            before, self._written = self._written, wanted
            if before and before[0] != wanted[0] and due is not None and due <= begun:
                self._figures.add_switch((begun + done) // 2 - due, (done - begun) // 2)
                late = (done - due) / NANOSECONDS
                if wanted[0] and late > self._parameters.late_tolerance:
                    self._miss(f'the rejector was {1e3 * late:.0f} ms late; look behind it')

    def _see_belt(self, running: bool | None) -> None:
        with self._changed:
            self._belt = running
            if running is not None:
                self._pulses.belt(running, time.monotonic_ns())


@dataclass
class _Figures:
    """Counts and timing errors in ns."""

    rejects: int = 0
    late_rejects: int = 0
    losses: int = 0
    switches: int = 0
    error_sum: int = 0
    largest_error: int = 0
    largest_uncertainty: int = 0

    def add_switch(self, error: int, uncertainty: int) -> None:
        """Note by how much a switch of the rejector was late."""
        self.switches += 1
        self.error_sum += error
        self.largest_error = max(self.largest_error, error, key=abs)
        self.largest_uncertainty = max(self.largest_uncertainty, uncertainty)

    def shown(self) -> dict[str, float]:
        """Return the figures by their names."""
        return {
            'rejects': self.rejects,
            'late rejects': self.late_rejects,
            'output losses': self.losses,
            'switches': self.switches,
            'switch error ms': 1e-6 * self.error_sum / max(self.switches, 1),
            'largest switch error ms': 1e-6 * self.largest_error,
            'switch uncertainty ms': 1e-6 * self.largest_uncertainty,
        }
