# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decisions on rejector, stop, permit and stations at each moment, without thread and port."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
import math
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

# Smallest deviation of the travel time of two merged products from that of the product before.
_OTHER_WAY = 0.2
_MAY_BE_TWO = {Reason.DISTANCE_FAULT.value, Reason.EDGE_MISMATCH.value}
# Longest time to the rejector; a later reject time is not on the clock of this machine.
_FURTHEST = 600 * NANOSECONDS
_CLOCK_STEP = 5_000_000  # ns
_PERMISSION_TIME = round(FRESH_TIME * NANOSECONDS)
# Reasons for which the speed by the eyes may be that of a belt that stood for a while.
_SPEED_IN_DOUBT = {Reason.BELT_STOPPED.value, Reason.BELT_SPEED_CHANGED.value}


# Counts and, in ms, errors of the times at which the rejector was switched; positive is late.
_FIGURES = (
    'rejects',
    'late rejects',
    'permits',
    'permits withheld',
    'not sorted',
    'output losses',
    'switches',
    'switch error ms',
    'largest switch error ms',
    'switch uncertainty ms',
)
_duration = partial(parameter, unit='s', minimum=0, maximum=60)


@dataclass(frozen=True)
class OutputParameters(Parameters):
    """Parameters of the rejector and the stop output."""

    node: ClassVar[str] = 'rejector'

    pulse: float = _duration(0.1, 'time for which the rejector acts for one product', minimum=0.001)
    min_pause: float = _duration(
        0.02, 'shortest pause of the rejector; pulses that are closer become one'
    )
    late_tolerance: float = _duration(
        0.01, 'largest delay of a pulse; later a rejected product may have passed: stop'
    )
    belt_margin: float = _duration(
        0.05, 'longer pulse at both ends, by this, if the belt stopped before it'
    )
    verdict_timeout: float = _duration(
        0.0,
        'from a product at the outfeed eye to the next verdict, at most: else eject and stop; '
        '0: the time to the rejector of the product before',
    )
    safe_state: str = parameter(
        'eject', 'state of the rejector while no verdicts are taken', choices=('eject', 'retract')
    )
    cycle: float = _duration(
        0.05,
        'period in which all outputs are written again and the belt input is read',
        minimum=0.005,
        maximum=10,
    )
    permit_margin: float = _duration(
        0.02,
        'time by which a permit begins before its product is at the rejector, and ends '
        'after it has passed',
        maximum=10,
    )
    watchdog_time: float = _duration(
        0.25,
        'time without a sign of life after which the machine ejects and stops by itself; '
        'after a longer one what was on the belt is in doubt',
        minimum=0.02,
    )
    record: str = parameter(
        '',
        'file that keeps what is on the belt over a restart; empty for one named after the '
        'outputs in $XDG_STATE_HOME/checkweigher, or ~/.local/state/checkweigher',
    )

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


class Switches(NamedTuple):
    """Times of the next switches of rejector, permit and any station, ns; infinite for none."""

    reject: float = math.inf
    permit: float = math.inf
    station: float = math.inf


class Times(NamedTuple):
    """Times of an item at rejector or station, at the outfeed eye and at the infeed eye, ns."""

    due: int
    since: int | None
    entered: int | None


class RejectWord:
    """The permission to run and the stop requests of reject, for a machine that may miss products.

    A permission is fresh for `FRESH_TIME`; without a fresh one reject has ended or hangs, and may
    have forgotten what it had asked for.
    """

    def __init__(self, missed: MissedProducts) -> None:
        self._missed = missed
        self._permission: tuple[int, bool] | None = None  # time of the last one, whether to run
        self._silent = False  # after the last permission has expired, until reject is back
        self._asked = ''  # reason for which reject wants the line to stop, known to it alone

    def permits(self, now: int) -> bool:
        """Return whether a permission to run is fresh."""
        came, run = self._permission or (now, False)
        if now - came > _PERMISSION_TIME:
            self._permission, self._silent, run = None, True, False
            self._missed.take(LatchEvent.FORGET)
        return run

    def take_permission(self, permission: Permission, now: int) -> None:
        """Process a permission that has come at `now`."""
        self._end_silence()
        self._permission = now, permission.run

    def take_request(self, request: StopRequest | None) -> None:
        """Process a stop request, None if it is taken back."""
        self._end_silence()
        if request is None:
            self._asked = ''
            self._missed.take(LatchEvent.RUN)
        elif request.reason is StopReason.NOT_READY:  # a reject node that was started again
            self._missed.take(LatchEvent.FORGET)
        elif request.reason is not StopReason.DRIVER_TROUBLE:
            self._asked = f'{request.reason}: {request.hint}'
        elif self._missed.text in request.hint:
            self._missed.take(LatchEvent.SHOW)

    def _end_silence(self) -> None:
        """Latch the request from before a silence: reject has forgotten it if it was restarted."""
        if self._silent and self._asked:
            self._missed.add(self._asked)
        self._silent = False


class RejectorControl:
    """Levels of the outputs at each moment, and products that the rejector can have missed.

    `now` is in ns of the monotonic clock throughout. `active` is false in the safe state,
    `connected` while the port cannot be switched. The line stops without a fresh permission of
    reject, while it is `held`, and for a missed product. `belt_runs` is None without a belt input.

    Pulses and permits follow from the places of the items. After a stop of the belt that was not
    measured these are in doubt: no item may pass, and the line stops until a person has looked.
    Only a machine that `permits` has permits. A machine has as many `stations` beside its
    rejector; in the safe state they rest, because the rejector takes all that is in doubt.
    """

    def __init__(
        self, parameters: OutputParameters, *, permits: bool = False, stations: int = 0
    ) -> None:
        def nanoseconds(seconds: float) -> int:
            return round(seconds * NANOSECONDS)

        self._late_tolerance = nanoseconds(parameters.late_tolerance)
        self._watchdog_time = nanoseconds(parameters.watchdog_time)
        self._after = nanoseconds(parameters.pulse + parameters.belt_margin)
        self._belt = BeltTime()
        times = PulseTimes(
            duration=nanoseconds(parameters.pulse),
            min_pause=nanoseconds(parameters.min_pause),
            late_tolerance=self._late_tolerance,
            belt_margin=nanoseconds(parameters.belt_margin),
        )
        # By the number of the station; 0 is the rejector.
        self._pulses = [RejectPulses(times, self._belt) for _ in range(1 + stations)]
        self._permitting = permits
        margin = nanoseconds(parameters.permit_margin)
        self._permits = Permits(self._belt, margin, times.min_pause)
        self._items = BeltItems()
        self._verdicts = VerdictWatch(nanoseconds(parameters.verdict_timeout))
        self.safe_levels = Levels(
            reject=parameters.safe_state == 'eject', stop=True, stations=(False,) * stations
        )
        self.active = self.held = self.connected = False
        self.belt_runs: bool | None = None
        self.missed = MissedProducts()
        self.reject_word = RejectWord(self.missed)
        self.figures: dict[str, float] = dict.fromkeys(_FIGURES, 0)
        self.clock = ClockStepWatch(_CLOCK_STEP)
        self._released = False  # the belt may have run since it was known to be empty
        self._may_run = False  # by the latest levels
        self._way: int | None = None  # ns of running belt from infeed eye to rejector, last item
        self._stood_at: int | None = None  # latest time at which the line stopped the belt
        self._latched = False  # by a missed product
        self._looked_at: int | None = None  # when a person had looked for all missed products
        self._alive: tuple[int, bool] | None = None  # last sign of life; whether it might run then

    def make_safe(self) -> None:
        """Enter the safe state; all items on the belt are in doubt."""
        if self._items:
            self._doubt('the outputs were made safe', self._items.names())
        self.active = self._released = self._may_run = False
        self._alive = None
        self._verdicts.clear()
        for pulses in self._pulses:
            pulses.clear()
        self._permits.clear()
        self._items.clear()

    def levels(self, now: int) -> Levels:
        """Return the levels that the outputs must have now."""
        to_monotonic, permitted = self.clock.look(), self.reject_word.permits(now)
        if not self.active:
            return self.safe_levels
        self._check_silence(now)  # before items are removed
        self._items.leave(self._belt.at(now))
        self._check_verdicts(now)
        self._check_unseen(now, to_monotonic)
        reject, *stations = (self._act(pulses, now) for pulses in self._pulses)
        latched = self.missed.state is not Latch.CLEAR
        if self._latched and not latched:
            self._looked_at = now
        self._latched = latched
        stop = not permitted or self.held or latched
        if stop and self._released and self.belt_runs is None:
            self._stand(now)
        self._may_run = not stop
        self._released |= self._may_run
        return Levels(reject, stop, self._permits.given(now), tuple(stations))

    def _act(self, pulses: RejectPulses, now: int) -> bool:
        """Return whether the rejector or a station has to act."""
        skipped = pulses.skipped
        acting = pulses.acting(now)
        if pulses.skipped > skipped:
            self.missed.add('the machine was too busy to switch the rejector; look behind it')
        return acting

    def _stand(self, now: int) -> None:
        """Record a stop of a belt without an input: the places of its items are unknown then."""
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
        """Return the state of the belt for the next start."""
        return OnBelt(self._released, self._items.names(), self.missed.texts)

    def alive(self, begun: int, done: int) -> None:
        """Process a sign of life that the machine got between two times."""
        self._check_silence(done)
        self._alive = begun, self._may_run

    def _check_silence(self, now: int) -> None:
        """Check for a silence after which the machine has stopped the belt by itself."""
        last, ran = self._alive or (now, False)
        if ran and now - last > self._watchdog_time:
            limit = self._watchdog_time / NANOSECONDS
            self._doubt(f'the machine had no sign of life for {limit:g} s', self._items.names())
            self._alive = None

    def next_switches(self, now: int) -> Switches:
        """Return the times at which the outputs switch next."""
        if not self.active:
            return Switches()
        reject, *stations = (pulses.next_change(now) for pulses in self._pulses)
        station = min(stations, default=math.inf)
        return Switches(reject, self._permits.next_change(now), station)

    def _eject_now(self, now: int, why: str) -> None:
        """Eject at once, perhaps another item, and latch the stop."""
        self._pulses[0].act(now)
        self.missed.add(why)

    def _check_verdicts(self, now: int) -> None:
        """Eject and stop if a verdict is overdue: the node that gives verdicts hangs."""
        if self._verdicts.is_overdue(now):
            within = f'{self._verdicts.timeout / NANOSECONDS:.2g} s'
            self._eject_now(
                now,
                f'a product left the belt and no verdict came within {within}; check that reject '
                'runs, and look behind the rejector',
            )

    def _check_unseen(self, now: int, to_monotonic: int | None) -> None:
        """Eject and stop if an item is at the rejector that the outfeed eye has not seen."""
        if self._way is None or to_monotonic is None:
            return
        latest = self._belt.at(now) - self._way - self._late_tolerance
        for item in self._items:
            if item.decision is None and item.entered is not None and not item.told:
                item.told = self._belt.at(item.entered + to_monotonic) < latest
                if item.told:
                    self._eject_now(now, f'{item} would be at the rejector by now; look for it')

    def edge(self, edge: EyeEdge, now: int) -> None:
        """Process an edge of the photo-eyes: a product that leaves the belt needs a verdict."""
        self._verdicts.edge(edge, now)
        self._items.edge(edge)

    def announce(self, item: Item) -> None:
        """Add the number of an item that the segmenter has announced."""
        self._items.announce(item)

    def verdict(self, verdict: Verdict, now: int) -> None:
        """Process a verdict: schedule a pulse, or permit an accepted item to pass."""
        self._verdicts.verdict(verdict)
        rejected = verdict.decision != Decision.ACCEPT
        self.figures['rejects'] += rejected
        if self.active:
            times = self._own_times(verdict, now)
            self._treat(verdict, times, self._at_station(verdict, times), now)
        elif rejected and not self.safe_levels.reject:
            item = f'item {verdict.item_id}'
            self.missed.add(f'{item}: the rejector was not active; look for it')

    def _treat(
        self, verdict: Verdict, times: Times | None, at_station: Times | None, now: int
    ) -> None:
        arrivals = [self._belt.arrival(*each)[0] for each in (times, at_station) if each]
        end = max(*arrivals, self._belt.at(now)) + self._after if arrivals else None
        passage = self._items.judge(verdict, end).passage
        if verdict.decision != Decision.ACCEPT:
            if arrivals:
                self._permits.deny(arrivals[0])
            if arrivals or not self._was_looked_for(verdict):
                self._reject(verdict, at_station, now)
            return
        if verdict.station:
            self._sort(at_station, now, verdict.station)
        if self._permitting:
            self._permit(arrivals, passage, times, now)

    def _permit(
        self, arrivals: list[int], passage: int | None, times: Times | None, now: int
    ) -> None:
        """Permit an accepted item to pass, if it is known when it arrives."""
        given = False
        if arrivals and passage is not None and not self._stood(times):
            given = self._permits.permit(arrivals[0], passage, now)
        self.figures['permits' if given else 'permits withheld'] += 1

    def _own_times(self, verdict: Verdict, now: int) -> Times | None:
        """Return the times of an item, None if its edges can be those of two products."""
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
        """Return the times of an item on the clock of `now`, None if they are not known."""
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
        """Return the times of an item with its station in place of the rejector."""
        if times is None or not verdict.station:
            return times
        if verdict.station_at is None or verdict.reject_at is None:
            return None
        return times._replace(due=times.due + verdict.station_at - verdict.reject_at)

    def _stood(self, times: Times | None) -> bool:
        """Return whether the line has stopped the belt since an item was at the outfeed eye."""
        since = None if times is None else times.since
        return since is not None and self._stood_at is not None and since < self._stood_at

    def _was_looked_for(self, verdict: Verdict) -> bool:
        """Return whether an item was on the belt when a person cleared it, and never left it.

        The line gives up such an item only after some time. If it is still there, it leaves the
        belt without a verdict, and the line stops for that.
        """
        to_monotonic = self.clock.look()
        if to_monotonic is None or verdict.t1 is None or verdict.t3 is not None:
            return False
        return self._looked_at is not None and verdict.t1 + to_monotonic < self._looked_at

    def _sort(self, times: Times | None, now: int, station: int) -> None:
        """Schedule a pulse for an accepted item; if it is missed, the item goes straight on."""
        known = times is not None and station < len(self._pulses) and not self._stood(times)
        if times is None or not known or now - times.due > self._late_tolerance:
            self.figures['not sorted'] += 1
        else:
            self._pulses[station].add(times.due, times.since, now, times.entered)

    def _reject(self, verdict: Verdict, times: Times | None, now: int) -> None:
        """Schedule a pulse, and check whether it can miss its item."""
        item, station = f'item {verdict.item_id}', verdict.station
        if station >= len(self._pulses):
            times = None
            self.missed.add(f'{item}: is for station {station}, which the outputs lack')
        if times is None:
            why = 'the time at which it is at the rejector is not known; look for it'
            self._eject_now(now, f'{item}: {why}')
            return
        late = self._pulses[station].add(times.due, times.since, now, times.entered)
        if late:
            self.figures['late rejects'] += 1
            after = f'{1e-6 * late:.0f} ms after its reject time'
            self.missed.add(f'{item}: its verdict came {after}; look for it behind the rejector')
        elif not self.connected:
            what = 'the rejector could not be reached; look for it behind the rejector'
            self.missed.add(f'{item}: {what}')
        elif self._stood(times):
            self.missed.add(f'{item}: the belt was stopped on its way to the rejector; look for it')

    def connect(self, now: int) -> None:
        """Process a new connection; the port has written the safe state, and the belt stood."""
        self.connected = True
        if self._released and self._items:
            self._doubt('the connection to the machine was lost', self._items.names())
        if any(pulses.begun(now) for pulses in self._pulses):
            self.missed.add('the rejector could not be reached when it should act; look behind it')

    def disconnect(self) -> None:
        """Process the loss of the connection."""
        self.figures['output losses'] += self.connected
        self.connected = False
        self.belt_runs = None

    def switched(self, before: Levels, after: Levels, due: Switches, begun: int, done: int) -> None:
        """Check the lateness of outputs that were switched between two times."""
        if before.reject != after.reject and due.reject <= begun:
            self._add_switch(1e-6 * ((begun + done) / 2 - due.reject), 1e-6 * (done - begun) / 2)
            if after.reject:
                self._check_lateness('the rejector was', done - due.reject)
        stations = zip(before.stations, after.stations, strict=True)
        if due.station <= begun and any(new and not old for old, new in stations):
            self._check_lateness('a station was', done - due.station)
        if before.permit and not after.permit:
            self._check_lateness('the end of a permit was', done - due.permit)

    def _add_switch(self, error: float, uncertainty: float) -> None:
        """Add a switch of the rejector to the figures; the error is positive if it was late, ms."""
        figures = self.figures
        figures['switches'] += 1
        figures['switch error ms'] += (error - figures['switch error ms']) / figures['switches']
        largest = 'largest switch error ms'
        figures[largest] = max(figures[largest], error, key=abs)
        figures['switch uncertainty ms'] = max(figures['switch uncertainty ms'], uncertainty)

    def _check_lateness(self, what: str, late: float) -> None:
        if late > self._late_tolerance:
            self.missed.add(f'{what} {1e-6 * late:.0f} ms late; look behind it')

    def belt(self, running: bool | None, now: int) -> None:
        """Process the belt input, None without one; while the belt stands no pulse changes."""
        self.belt_runs = running
        if running is False:
            self._belt.stop(now)
        elif running and self._belt.stopped:
            here = self._belt.run(now)
            for pulses in self._pulses:
                pulses.resume(here)
