# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decisions of the outputs: what rejector and stop output have to be, without thread and port."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from checkweigher_driver.line_io.clock_steps import ClockStepWatch
from checkweigher_driver.line_io.missed_products import Latch, LatchEvent, MissedProducts
from checkweigher_driver.line_io.reject_pulses import PulseTimes, RejectPulses
from checkweigher_driver.line_io.verdict_watch import VerdictWatch
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.reasons import Reason, StopReason
from checkweigher_dsp.records import NANOSECONDS, Decision, EyeEdge, Verdict

# A reject time further ahead is not on the clock of this machine.
_FURTHEST = 600 * NANOSECONDS
_CLOCK_STEP = 5_000_000  # ns
# The speed by the eyes may then be that of a belt that stood for a while.
_SPEED_IN_DOUBT = {Reason.BELT_STOPPED.value, Reason.BELT_SPEED_CHANGED.value}


@dataclass(frozen=True)
class OutputParameters(Parameters):
    """How rejector and stop are switched."""

    node: ClassVar[str] = 'rejector'

    pulse: float = parameter(
        0.1, 'time for which the rejector acts for one product', unit='s', minimum=0.001, maximum=60
    )
    min_pause: float = parameter(
        0.02, 'shortest pause of the rejector; pulses that are closer become one', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    late_tolerance: float = parameter(
        0.01, 'largest delay of a pulse; later a rejected product may have passed: stop', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    belt_margin: float = parameter(
        0.05, 'longer pulse at both ends, by this, if the belt stopped before it', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    verdict_timeout: float = parameter(
        0.0, 'from a product at the outfeed eye to the next verdict, at most: else eject and stop; '
        '0: the time to the rejector of the product before', unit='s', minimum=0, maximum=60,
    )  # fmt: skip
    safe_state: str = parameter(
        'eject', 'state of the rejector while no verdicts are taken', choices=('eject', 'retract')
    )
    cycle: float = parameter(
        0.05, 'period in which all outputs are written again and the belt input is read', unit='s',
        minimum=0.005, maximum=10,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_pause > 10 * self.pulse:
            raise ParameterError(
                f'rejector.min_pause: {self.min_pause:g} s is more than ten pulses of '
                f'{self.pulse:g} s'
            )


class Levels(NamedTuple):
    """Rejector and stop output, on or off."""

    reject: bool
    stop: bool


@dataclass
class SwitchFigures:
    """Counts, and how far the rejector was switched from when it was due, ns; positive is late."""

    rejects: int = 0
    late_rejects: int = 0
    losses: int = 0
    switches: int = 0
    error_sum: int = 0
    largest_error: int = 0
    largest_uncertainty: int = 0

    def shown(self) -> dict[str, float]:
        """Return the figures by their names in /diagnostics."""
        return {
            'rejects': self.rejects,
            'late rejects': self.late_rejects,
            'output losses': self.losses,
            'switches': self.switches,
            'switch error ms': 1e-6 * self.error_sum / max(self.switches, 1),
            'largest switch error ms': 1e-6 * self.largest_error,
            'switch uncertainty ms': 1e-6 * self.largest_uncertainty,
        }


class RejectorControl:
    """Levels of rejector and stop output at each moment, and what the rejector can have missed.

    `now` is ns of the monotonic clock throughout. `active` tells whether the safe state was left,
    `connected` whether the port can be switched; `stop_requested` and `held` are the two reasons to
    stop the line beside a missed product; `belt_runs` is None where no input tells.
    """

    def __init__(self, parameters: OutputParameters) -> None:
        def nanoseconds(seconds: float) -> int:
            return round(seconds * NANOSECONDS)

        self._late_tolerance = nanoseconds(parameters.late_tolerance)
        self._pulses = RejectPulses(
            PulseTimes(
                duration=nanoseconds(parameters.pulse),
                min_pause=nanoseconds(parameters.min_pause),
                late_tolerance=self._late_tolerance,
                belt_margin=nanoseconds(parameters.belt_margin),
            )
        )
        self._verdicts = VerdictWatch(nanoseconds(parameters.verdict_timeout))
        self.safe_levels = Levels(reject=parameters.safe_state == 'eject', stop=True)
        self.active = self.held = self.connected = False
        self.stop_requested = True  # until a request says that the line may run
        self.belt_runs: bool | None = None
        self.missed = MissedProducts()
        self.figures = SwitchFigures()
        self.clock = ClockStepWatch(_CLOCK_STEP)

    def make_safe(self) -> None:
        """Take the safe state, and forget what was to come."""
        self.active = False
        self._verdicts.clear()
        self._pulses.clear()

    def levels(self, now: int) -> Levels:
        """Return what the outputs have to be."""
        if not self.active:
            return self.safe_levels
        self._check_verdicts(now)
        skipped = self._pulses.skipped
        reject = self._pulses.acting(now)
        if self._pulses.skipped > skipped:
            self.missed.add('the machine was too busy to switch the rejector; look behind it')
        missed = self.missed.state is not Latch.CLEAR
        return Levels(reject, stop=self.stop_requested or self.held or missed)

    def next_switch(self, now: int) -> int | None:
        """Return when the rejector switches next, ns; None if that is not to come."""
        return self._pulses.next_change(now) if self.active else None

    def _check_verdicts(self, now: int) -> None:
        """Eject and stop if no verdict comes: the node that gives them hangs."""
        if self._verdicts.is_overdue(now):
            self._pulses.add(None, None, now)
            self.missed.add(
                'a product left the belt and no verdict came within '
                f'{self._verdicts.timeout / NANOSECONDS:.2g} s; check that reject runs, and look '
                'behind the rejector'
            )

    def edge(self, edge: EyeEdge, now: int) -> None:
        """Take an edge of the photo-eyes: a product that leaves the belt must have its verdict."""
        self._verdicts.edge(edge, now)

    def verdict(self, verdict: Verdict, now: int) -> None:
        """Take a verdict, and schedule the pulse of a product that is not accepted."""
        self._verdicts.verdict(verdict)
        if verdict.decision == Decision.ACCEPT:
            return
        self.figures.rejects += 1
        item = f'item {verdict.item_id}'
        if not self.active:
            if not self.safe_levels.reject:
                self.missed.add(f'{item}: the rejector was not active; look for it')
            return
        late = self._schedule(verdict, now)
        if late is None:
            self.missed.add(f'{item}: the time at which it is at the rejector is not known')
        elif late:
            self.figures.late_rejects += 1
            self.missed.add(
                f'{item}: its verdict came {1e-6 * late:.0f} ms after its reject time; look for it '
                'behind the rejector'
            )
        elif not self.connected:
            self.missed.add(
                f'{item}: the rejector could not be reached; look for it behind the rejector'
            )

    def _schedule(self, verdict: Verdict, now: int) -> int | None:
        """Schedule a pulse; return by how many ns it is late, None if its time is not known."""
        to_monotonic = self.clock.look()
        in_doubt = self.belt_runs is None and not _SPEED_IN_DOUBT.isdisjoint(verdict.reasons)
        if verdict.reject_at is None or to_monotonic is None or in_doubt:
            return self._pulses.add(None, None, now)
        due = verdict.reject_at + to_monotonic
        if due - now > _FURTHEST:
            return self._pulses.add(None, None, now)
        since = None if verdict.t3 is None else verdict.t3 + to_monotonic
        entered = None if verdict.t1 is None else verdict.t1 + to_monotonic
        return self._pulses.add(due, since, now, entered)

    def connect(self, now: int) -> None:
        """Take that the port can be switched."""
        self.connected = True
        if self._pulses.begun(now):
            self.missed.add('the rejector could not be reached when it should act; look behind it')

    def disconnect(self) -> None:
        """Take that the port cannot be switched."""
        self.figures.losses += self.connected
        self.connected = False
        self.belt_runs = None

    def switched(self, reject: bool, due: int, begun: int, done: int) -> None:
        """Take that the rejector was switched between two moments, after it was due."""
        figures, error = self.figures, (begun + done) // 2 - due
        figures.switches += 1
        figures.error_sum += error
        figures.largest_error = max(figures.largest_error, error, key=abs)
        figures.largest_uncertainty = max(figures.largest_uncertainty, (done - begun) // 2)
        if reject and done - due > self._late_tolerance:
            self.missed.add(f'the rejector was {1e-6 * (done - due):.0f} ms late; look behind it')

    def belt(self, running: bool | None, now: int) -> None:
        """Take the belt input, None where there is none."""
        self.belt_runs = running
        if running is not None:
            self._pulses.belt(running, now)

    def take_request(self, stop: bool, reason: str, hint: str) -> None:
        """Take a stop request."""
        self.stop_requested = stop
        if not stop:
            self.missed.take(LatchEvent.RUN)
        elif reason == StopReason.NOT_READY:  # a reject node that was started again
            self.missed.take(LatchEvent.FORGET)
        elif reason == StopReason.DRIVER_TROUBLE and self.missed.text in hint:
            self.missed.take(LatchEvent.SHOW)
