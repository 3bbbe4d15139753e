# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decisions of the outputs: what rejector and stop output have to be, without thread and port."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    EyeEdge,
    Item,
    Permission,
    StopRequest,
    Verdict,
)
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_core.ros.ports import FRESH_TIME
from checkweigher_driver.line_io.belt_items import BeltItems
from checkweigher_driver.line_io.belt_record import OnBelt
from checkweigher_driver.line_io.clock_steps import ClockStepWatch
from checkweigher_driver.line_io.missed_products import Latch, LatchEvent, MissedProducts
from checkweigher_driver.line_io.permits import Permits
from checkweigher_driver.line_io.reject_pulses import BeltTime, PulseTimes, RejectPulses
from checkweigher_driver.line_io.verdict_watch import VerdictWatch

# Relative to the product before: how far the travel time of two merged products is off.
_OTHER_WAY = 0.2
_MAY_BE_TWO = {Reason.DISTANCE_FAULT.value, Reason.EDGE_MISMATCH.value}
# A reject time further ahead is not on the clock of this machine.
_FURTHEST = 600 * NANOSECONDS
_CLOCK_STEP = 5_000_000  # ns
_PERMISSION_TIME = round(FRESH_TIME * NANOSECONDS)
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
    permit_margin: float = parameter(
        0.02, 'time by which a permit begins before its product is at the rejector, and ends '
        'after it has passed', unit='s', minimum=0, maximum=10,
    )  # fmt: skip
    watchdog_time: float = parameter(
        0.25, 'time without a sign of life after which the machine ejects and stops by itself; '
        'after a longer one what was on the belt is in doubt', unit='s', minimum=0.02, maximum=60,
    )  # fmt: skip
    record: str = parameter(
        '', 'file that keeps what is on the belt over a restart; empty for one named after the '
        'outputs in $XDG_STATE_HOME/checkweigher, or ~/.local/state/checkweigher',
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_pause > 10 * self.pulse:
            raise ParameterError(
                f'rejector.min_pause: {self.min_pause:g} s is more than ten pulses of '
                f'{self.pulse:g} s'
            )


class Levels(NamedTuple):
    """Rejector, stop output, permit to pass the rejector and each station, on or off."""

    reject: bool
    stop: bool
    permit: bool = False
    stations: tuple[bool, ...] = ()


@dataclass
class SwitchFigures:
    """Counts, and how far the rejector was switched from when it was due, ns; positive is late."""

    rejects: int = 0
    late_rejects: int = 0
    permits: int = 0
    permits_withheld: int = 0
    unsorted: int = 0
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
            'permits': self.permits,
            'permits withheld': self.permits_withheld,
            'not sorted': self.unsorted,
            'output losses': self.losses,
            'switches': self.switches,
            'switch error ms': 1e-6 * self.error_sum / max(self.switches, 1),
            'largest switch error ms': 1e-6 * self.largest_error,
            'switch uncertainty ms': 1e-6 * self.largest_uncertainty,
        }


class Switches(NamedTuple):
    """When rejector, permit and the next station switch, ns; None where that is not to come."""

    reject: int | None
    permit: int | None
    station: int | None = None


class Times(NamedTuple):
    """When an item is told to the rejector, at the outfeed eye and at the infeed eye, ns."""

    due: int
    since: int | None
    entered: int | None


class RejectorControl:
    """Levels of the outputs at each moment, and what the rejector can have missed.

    `now` is ns of the monotonic clock throughout. `active` tells whether the safe state was left,
    `connected` whether the port can be switched. The line stops without a fresh permission of
    reject, while it is `held`, and for a missed product; `belt_runs` is None where no input tells.

    Pulses and permits rest on where the items are. Where the belt may have stood unseen that is
    not known any more: nothing may pass, and the line stops until a person has looked. There
    are permits only for a machine that `permits`. A machine has as many `stations` beside its
    rejector; in the safe state they rest, for the rejector has what is in doubt.
    """

    def __init__(
        self, parameters: OutputParameters, *, permits: bool = False, stations: int = 0
    ) -> None:
        def nanoseconds(seconds: float) -> int:
            return round(seconds * NANOSECONDS)

        self._late_tolerance = nanoseconds(parameters.late_tolerance)
        self._watchdog_time = nanoseconds(parameters.watchdog_time)
        self._belt_margin = nanoseconds(parameters.belt_margin)
        self._after = nanoseconds(parameters.pulse) + self._belt_margin
        pause = nanoseconds(parameters.min_pause)
        self._belt = BeltTime()
        times = PulseTimes(
            duration=nanoseconds(parameters.pulse),
            min_pause=pause,
            late_tolerance=self._late_tolerance,
            belt_margin=self._belt_margin,
        )
        self._pulses = RejectPulses(times, self._belt)
        self._stations = [RejectPulses(times, self._belt) for _ in range(stations)]
        self._permitting = permits
        self._permits = Permits(self._belt, nanoseconds(parameters.permit_margin), pause)
        self._items = BeltItems()
        self._verdicts = VerdictWatch(nanoseconds(parameters.verdict_timeout))
        self.safe_levels = Levels(
            reject=parameters.safe_state == 'eject', stop=True, stations=(False,) * stations
        )
        self.active = self.held = self.connected = False
        self._permission: tuple[int, bool] | None = None  # when the last one came; whether to run
        self._silent = False  # no permission has come for too long, and reject has said nothing yet
        self.belt_runs: bool | None = None
        self.missed = MissedProducts()
        self.figures = SwitchFigures()
        self.clock = ClockStepWatch(_CLOCK_STEP)
        self._released = False  # since the belt was known to be empty or all on it in doubt
        self._may_run = False  # by the levels that were asked for last
        self._way: int | None = None  # of the belt, ns, that the last item took to the rejector
        self._asked = ''  # why reject wants the line to stop, by what it alone knows
        self._stood_at: int | None = None  # when it last might not run
        self._latched = False  # by a missed product
        self._looked_at: int | None = None  # when a person had looked for all that was missed
        self._alive: tuple[int, bool] | None = None  # last sign of life; whether it might run then

    def make_safe(self) -> None:
        """Take the safe state; what is on the belt is in doubt."""
        if self._items:
            self._doubt('the outputs were made safe', self._items.names())
        self.active = self._released = self._may_run = False
        self._alive = None
        self._verdicts.clear()
        for pulses in (self._pulses, *self._stations):
            pulses.clear()
        self._permits.clear()
        self._items.clear()

    def levels(self, now: int) -> Levels:
        """Return what the outputs have to be."""
        permitted = self._is_permitted(now)
        if not self.active:
            return self.safe_levels
        self._check_silence(now)  # while it is known what was on the belt before
        self._items.leave(self._belt.at(now))
        self._check_verdicts(now)
        reject, *stations = (self._act(pulses, now) for pulses in (self._pulses, *self._stations))
        latched = self.missed.state is not Latch.CLEAR
        if self._latched and not latched:
            self._looked_at = now
        self._latched = latched
        stop = not permitted or self.held or latched
        if stop and self._released:
            self._stand(now)
        self._may_run = not stop
        self._released |= self._may_run
        return Levels(reject, stop, self._permits.given(now), tuple(stations))

    def _is_permitted(self, now: int) -> bool:
        """Return whether a permission to run is fresh; without any, reject has ended or hangs."""
        came, run = self._permission or (now, False)
        if now - came > _PERMISSION_TIME:
            self._permission, self._silent, run = None, True, False
            self.missed.take(LatchEvent.FORGET)
        return run

    def _act(self, pulses: RejectPulses, now: int) -> bool:
        """Tell whether the rejector or a station is to act."""
        skipped = pulses.skipped
        acting = pulses.acting(now)
        if pulses.skipped > skipped:
            self.missed.add('the machine was too busy to switch the rejector; look behind it')
        return acting

    def _stand(self, now: int) -> None:
        """Note that the line stops the belt: without an input, where the items are is not known."""
        if self.belt_runs is not None:
            return
        self._stood_at = now
        self._permits.clear()
        bad = [each for each in self._items if each.decision not in (None, Decision.ACCEPT)]
        if names := [str(each) for each in bad if not each.told]:
            self._doubt('the belt was stopped', names)
        for each in bad:
            each.told = True

    def _doubt(self, why: str, names: Sequence[str] = ()) -> None:
        self._permits.clear()
        what = f'look for {", ".join(names)}' if names else 'look for what is on the belt'
        self.missed.add(f'{why} before all had passed the rejector: {what}')

    def on_belt(self) -> OnBelt:
        """Return what the next start has to know."""
        return OnBelt(self._released, self._items.names(), self.missed.texts)

    def alive(self, begun: int, done: int) -> None:
        """Take a sign of life that the machine got between two moments."""
        self._check_silence(done)
        self._alive = begun, self._may_run

    def _check_silence(self, now: int) -> None:
        """Note that after a longer silence the machine has stopped the belt by itself."""
        last, ran = self._alive or (now, False)
        if ran and now - last > self._watchdog_time:
            limit = self._watchdog_time / NANOSECONDS
            self._doubt(f'the machine had no sign of life for {limit:g} s', self._items.names())
            self._alive = None

    def next_switches(self, now: int) -> Switches:
        """Return when rejector and permit switch next, ns; None for what is not to come."""
        if not self.active:
            return Switches(None, None)
        changes = (pulses.next_change(now) for pulses in self._stations)
        return Switches(
            self._pulses.next_change(now),
            self._permits.next_change(now),
            min((change for change in changes if change is not None), default=None),
        )

    def _check_verdicts(self, now: int) -> None:
        """Eject and stop if no verdict comes: the node that gives them hangs."""
        if self._verdicts.is_overdue(now):
            self._pulses.add(None, None, now)
            self.missed.add(
                'a product left the belt and no verdict came within '
                f'{self._verdicts.timeout / NANOSECONDS:.2g} s; check that reject runs, and look '
                'behind the rejector'
            )
        to_monotonic = self.clock.look()
        if self._way is None or to_monotonic is None:
            return
        latest = self._belt.at(now) - self._way - self._late_tolerance
        for item in self._items:
            if item.decision is None and item.entered is not None and not item.told:
                item.told = self._belt.at(item.entered + to_monotonic) < latest
                if item.told:  # as when the eyes were not read while it left the belt
                    self._pulses.add(None, None, now)
                    self.missed.add(f'{item} would be at the rejector by now; look for it')

    def edge(self, edge: EyeEdge, now: int) -> None:
        """Take an edge of the photo-eyes: a product that leaves the belt must have its verdict."""
        self._verdicts.edge(edge, now)
        self._items.edge(edge)

    def announce(self, item: Item) -> None:
        """Add the number of an item that the segmenter has announced."""
        self._items.announce(item)

    def verdict(self, verdict: Verdict, now: int) -> None:
        """Take a verdict: schedule a pulse, or permit an accepted product to pass."""
        self._verdicts.verdict(verdict)
        rejected = verdict.decision != Decision.ACCEPT
        self.figures.rejects += rejected
        item = f'item {verdict.item_id}'
        if not self.active:
            if rejected and not self.safe_levels.reject:
                self.missed.add(f'{item}: the rejector was not active; look for it')
            return
        times = self._own_times(verdict, now)
        arrival = None if times is None else self._belt.arrival(*times)[0]
        at_station = self._at_station(verdict, times)
        last = arrival
        if arrival is not None and at_station is not None:
            last = max(arrival, self._belt.arrival(*at_station)[0])
        end = None if last is None else max(last, self._belt.at(now)) + self._after
        passage = self._items.judge(verdict, end).passage
        if rejected:
            if arrival is not None:
                self._permits.deny(arrival)
            if times is not None or not self._was_looked_for(verdict):
                self._reject(item, at_station, now, verdict.station)
            return
        if verdict.station:
            self._sort(at_station, now, verdict.station)
        if self._permitting:
            given = False
            if arrival is not None and passage is not None and not self._stood(times):
                given = self._permits.permit(arrival, passage, now)
            self.figures.permits += given
            self.figures.permits_withheld += not given

    def _own_times(self, verdict: Verdict, now: int) -> Times | None:
        """Return when an item is where, unless its edges are those of two products."""
        times = self._times(verdict, now)
        if times is None or times.entered is None:
            return times
        way, before = self._belt.arrival(*times)[0] - self._belt.at(times.entered), self._way
        if not _MAY_BE_TWO.intersection(verdict.reasons):
            self._way = way
        elif before is not None and abs(way - before) > _OTHER_WAY * before:
            return None
        return times

    def _times(self, verdict: Verdict, now: int) -> Times | None:
        """Return when an item is where, on the clock of `now`; None if that is not known."""
        to_monotonic = self.clock.look()
        in_doubt = self.belt_runs is None and not _SPEED_IN_DOUBT.isdisjoint(verdict.reasons)
        if verdict.reject_at is None or to_monotonic is None or in_doubt:
            return None
        due = verdict.reject_at + to_monotonic
        if due - now > _FURTHEST:
            return None
        t1, t3 = (None if t is None else t + to_monotonic for t in (verdict.t1, verdict.t3))
        return Times(due, t3, t1)

    def _at_station(self, verdict: Verdict, times: Times | None) -> Times | None:
        """Return when an item is where, with the time at its station in place of the rejector."""
        if times is None or not verdict.station:
            return times
        if verdict.station_at is None or verdict.reject_at is None:
            return None
        return times._replace(due=times.due + verdict.station_at - verdict.reject_at)

    def _stood(self, times: Times | None) -> bool:
        """Tell whether the line has stopped the belt since an item was at the outfeed eye."""
        since = None if times is None else times.since
        return since is not None and self._stood_at is not None and since < self._stood_at

    def _was_looked_for(self, verdict: Verdict) -> bool:
        """Tell whether an item was on the belt when a person cleared it, and never left it.

        The line gives up such an item only after some time. If it is there all the same, it leaves
        the belt without a verdict, and the line stops for that.
        """
        to_monotonic = self.clock.look()
        if to_monotonic is None or verdict.t1 is None or verdict.t3 is not None:
            return False
        return self._looked_at is not None and verdict.t1 + to_monotonic < self._looked_at

    def _sort(self, times: Times | None, now: int, station: int) -> None:
        """Have a station take an accepted item; one that it misses goes on with the others."""
        known = times is not None and station <= len(self._stations) and not self._stood(times)
        if times is None or not known or now - times.due > self._late_tolerance:
            self.figures.unsorted += 1
        else:
            self._stations[station - 1].add(times.due, times.since, now, times.entered)

    def _reject(self, item: str, times: Times | None, now: int, station: int = 0) -> None:
        """Schedule a pulse, and see whether it can miss its item."""
        if station > len(self._stations):
            times = None
            self.missed.add(f'{item}: is for station {station}, which the outputs lack')
        if times is None:
            self._pulses.add(None, None, now)
            self.missed.add(
                f'{item}: the time at which it is at the rejector is not known; look for it'
            )
            return
        pulses = self._stations[station - 1] if station else self._pulses
        late = pulses.add(times.due, times.since, now, times.entered)
        if late:
            self.figures.late_rejects += 1
            self.missed.add(
                f'{item}: its verdict came {1e-6 * late:.0f} ms after its reject time; look for it '
                'behind the rejector'
            )
        elif not self.connected:
            self.missed.add(
                f'{item}: the rejector could not be reached; look for it behind the rejector'
            )
        elif self._stood(times):
            self.missed.add(f'{item}: the belt was stopped on its way to the rejector; look for it')

    def connect(self, now: int) -> None:
        """Note that the port can be switched; before that it was made safe, and the belt stood."""
        self.connected = True
        if self._released and self._items:
            self._doubt('the connection to the machine was lost', self._items.names())
        if any(pulses.begun(now) for pulses in (self._pulses, *self._stations)):
            self.missed.add('the rejector could not be reached when it should act; look behind it')

    def disconnect(self) -> None:
        """Note that the port cannot be switched."""
        self.figures.losses += self.connected
        self.connected = False
        self.belt_runs = None

    def switched(self, before: Levels, after: Levels, due: Switches, begun: int, done: int) -> None:
        """Note that outputs were switched between two moments, after they were due."""
        if before.reject != after.reject and due.reject is not None and due.reject <= begun:
            figures, error = self.figures, (begun + done) // 2 - due.reject
            figures.switches += 1
            figures.error_sum += error
            figures.largest_error = max(figures.largest_error, error, key=abs)
            figures.largest_uncertainty = max(figures.largest_uncertainty, (done - begun) // 2)
            self._check_lateness('the rejector was', after.reject, done - due.reject)
        if before.stations != after.stations and due.station is not None and due.station <= begun:
            on = any(
                new and not old for old, new in zip(before.stations, after.stations, strict=True)
            )
            self._check_lateness('a station was', on, done - due.station)
        if before.permit and not after.permit and due.permit is not None:
            self._check_lateness('the end of a permit was', True, done - due.permit)

    def _check_lateness(self, what: str, matters: bool, late: int) -> None:
        if matters and late > self._late_tolerance:
            self.missed.add(f'{what} {1e-6 * late:.0f} ms late; look behind it')

    def belt(self, running: bool | None, now: int) -> None:
        """Take the belt input, None where there is none."""
        self.belt_runs = running
        if running is not None:
            resumes, here = running and self._belt.stopped, self._belt.at(now)
            self._pulses.belt(running, now)
            for pulses in self._stations if resumes else ():
                pulses.resume(here)

    def take_permission(self, permission: Permission, now: int) -> None:
        """Process a permission of reject."""
        self._end_silence()
        self._permission = now, permission.run

    def take_request(self, request: StopRequest | None) -> None:
        """Process a stop request: what it shows, or takes back if it is None."""
        self._end_silence()
        if request is None:
            self._asked = ''
            self.missed.take(LatchEvent.RUN)
        elif request.reason is StopReason.NOT_READY:  # a reject node that was started again
            self.missed.take(LatchEvent.FORGET)
        elif request.reason is not StopReason.DRIVER_TROUBLE:
            self._asked = f'{request.reason}: {request.hint}'
        elif self.missed.text in request.hint:
            self.missed.take(LatchEvent.SHOW)

    def _end_silence(self) -> None:
        """Latch what reject asked for before a silence: after a restart it knows nothing of it."""
        if self._silent and self._asked:
            self.missed.add(self._asked)
        self._silent = False
