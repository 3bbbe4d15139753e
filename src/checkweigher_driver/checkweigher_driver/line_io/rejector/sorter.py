# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Route of each item after its verdict: to the rejector, to a station, or straight on."""

import math

from checkweigher_core.records import Decision, Verdict
from checkweigher_driver.line_io.rejector.arrivals import Arrivals, Times, at_station
from checkweigher_driver.line_io.rejector.belt_items import BeltItems
from checkweigher_driver.line_io.rejector.belt_motion import BeltMotion
from checkweigher_driver.line_io.rejector.missed_products import MissedProducts
from checkweigher_driver.line_io.rejector.permits import Permits
from checkweigher_driver.line_io.rejector.reject_pulses import PulseTimes, RejectPulses
from checkweigher_driver.line_io.rejector.switching import Switches


class Sorter:
    """Schedules of the pulses of rejector and stations, and of the permits to pass the rejector.

    `stations` is the number of sorting stations in addition to the rejector. A permit has a margin
    of `permit_margin` in ns at both ends. If `permit_margin` is None, the machine has no permit
    output. A message on each rejected item that may be missed is added to `missed`. An accepted
    item that may miss its station is only counted.
    """

    def __init__(
        self,
        times: PulseTimes,
        stations: int,
        permit_margin: int | None,
        motion: BeltMotion,
        arrivals: Arrivals,
        missed: MissedProducts,
    ) -> None:
        self._times = times
        self._motion = motion
        self._arrivals = arrivals
        self._missed = missed
        # Index 0 is the rejector, and index n is station n.
        self._pulses = [RejectPulses(times, motion.time) for _ in range(1 + stations)]
        self._permitting = permit_margin is not None
        self.permits = Permits(motion.time, permit_margin or 0, times.min_pause)
        self.figures: dict[str, float] = {
            'late rejects': 0,
            'permits': 0,
            'permits withheld': 0,
            'not sorted': 0,
        }

    def sort(self, verdict: Verdict, items: BeltItems, now: int, *, reached: bool) -> None:
        """Record the verdict of an item in `items`, and schedule the pulse and permit of the item.

        `reached` is false if no output can be switched.
        """
        times = self._arrivals.times(verdict, now)
        there, belt = at_station(verdict, times), self._motion.time
        arrivals = [belt.arrival(*each)[0] for each in (times, there) if each]
        end = None
        if arrivals:
            end = max(*arrivals, belt.at(now)) + self._times.duration + self._times.belt_margin
        passage = items.judge(verdict, end).passage
        if verdict.decision != Decision.ACCEPT:
            if arrivals:
                self.permits.deny(arrivals[0])
            if arrivals or not self._was_looked_for(verdict):
                self._reject(verdict, there, now, reached=reached)
            return
        if verdict.station:
            self._divert(there, now, verdict.station)
        if self._permitting:
            self._permit(times, passage, now)

    def _permit(self, times: Times | None, passage: int | None, now: int) -> None:
        """Add the permit of an accepted item, and count the permit as given or as withheld.

        The permit is withheld if the arrival or the passage of the item is unknown, if an
        unmeasured stop of the belt followed the item's outfeed edge, or if the item is already at
        the rejector.
        """
        given = False
        if times is not None and passage is not None and not self._was_stopped(times):
            given = self.permits.permit(self._motion.time.arrival(*times)[0], passage, now)
        self.figures['permits' if given else 'permits withheld'] += 1

    def _was_stopped(self, times: Times | None) -> bool:
        """Return whether an unmeasured stop of the belt followed the item's outfeed edge."""
        return times is not None and self._motion.was_stopped_since(times.since)

    def _was_looked_for(self, verdict: Verdict) -> bool:
        """Return whether a person has cleared the belt while the item was on it.

        If a person has removed an item, its verdict comes only after the longest travel time of an
        item. If the item is still on the belt, it later passes the outfeed eye and gets no further
        verdict, which stops the line.
        """
        looked_at = self._missed.looked_at
        return looked_at is not None and self._arrivals.entered_before(verdict, looked_at)

    def _divert(self, times: Times | None, now: int, station: int) -> None:
        """Add the pulse of a station for an accepted item.

        The item is counted and goes straight on if its arrival is unknown, if the station has no
        output, if an unmeasured stop of the belt followed the item's outfeed edge, or if the pulse
        would be too late.
        """
        known = station < len(self._pulses) and not self._was_stopped(times)
        if times is None or not known or now - times.due > self._times.late_tolerance:
            self.figures['not sorted'] += 1
        else:
            self._pulses[station].add(times.due, times.since, now, times.entered)

    def _reject(self, verdict: Verdict, times: Times | None, now: int, *, reached: bool) -> None:
        """Add the pulse for a rejected item, and check whether the pulse may miss the item.

        If the arrival of the item is unknown, or if its station has no output, the rejector ejects
        at time `now`, and the item is reported as missed.
        """
        item, station = f'item {verdict.item_id}', verdict.station
        if station >= len(self._pulses):
            times = None
            self._missed.add(f'{item}: is for station {station}, which has no output')
        if times is None:
            self.eject(now, f'{item}: its arrival time at the rejector is unknown; look for it')
            return
        late, why = self._pulses[station].add(times.due, times.since, now, times.entered), ''
        if late:
            self.figures['late rejects'] += 1
            why = (
                f'its verdict came {1e-6 * late:.0f} ms after its reject time; look for it behind '
                'the rejector'
            )
        elif not reached:
            why = 'the rejector could not be reached; look for it behind the rejector'
        elif self._was_stopped(times):
            why = 'the belt was stopped on its way to the rejector; look for it'
        if why:
            self._missed.add(f'{item}: {why}')

    def eject(self, now: int, why: str) -> None:
        """Begin to eject at time `now`, even if another item is hit, and stop the line.

        `why` is a message for the person who resets the stop.
        """
        self._pulses[0].act(now)
        self._missed.add(why)

    def acting(self, now: int) -> list[bool]:
        """Return whether the rejector and each station have to act at time `now`, in this order.

        If a pulse has passed without a call, the next call reports a missed product, which stops
        the line.
        """
        skipped = sum(pulses.skipped for pulses in self._pulses)
        acting = [pulses.acting(now) for pulses in self._pulses]
        if sum(pulses.skipped for pulses in self._pulses) > skipped:
            self._missed.add('the computer was too busy to switch the rejector; look behind it')
        return acting

    def next_switches(self, now: int) -> Switches:
        """Return the times of the next changes of the outputs."""
        reject, *stations = (pulses.next_change(now) for pulses in self._pulses)
        permit = self.permits.next_change(now)
        return Switches(reject, permit, min(stations, default=math.inf))

    def reconnect(self, now: int) -> None:
        """Report a missed product if a pulse has begun while the outputs could not be switched.

        The method is called after the outputs were connected again.
        """
        if any(pulses.begun(now) for pulses in self._pulses):
            self._missed.add('the rejector could not be reached in time to act; look behind it')

    def resume(self, here: int) -> None:
        """Extend all unfinished pulses by `belt_margin` at both ends after a stop of the belt.

        `here` is the belt time of the stop in ns. A pulse that has not begun is not extended to a
        time before `here`.
        """
        for pulses in self._pulses:
            pulses.resume(here)

    def clear(self) -> None:
        """Cancel all pulses and permits."""
        for pulses in self._pulses:
            pulses.clear()
        self.permits.clear()
