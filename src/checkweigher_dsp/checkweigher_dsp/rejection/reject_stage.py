# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The verdict on each item, and when the rejector has to have it.

The stage counts the items itself, from the photo-eyes: one whose mass never comes, because a stage
before it hung or died, is a FAULT in time for the rejector all the same.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
import math

from checkweigher_dsp.items.item import Item
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import (
    NANOSECONDS,
    Decision,
    ExternalReject,
    EyeEdge,
    LineHistory,
    MassEstimate,
    Verdict,
    foreign,
)
from checkweigher_dsp.rejection.batch_rules import BatchRules, BatchTally
from checkweigher_dsp.rejection.eye_items import Arrival, EyeItems
from checkweigher_dsp.rejection.inspections import Inspections, Passage
from checkweigher_dsp.rejection.items import RejectItem, RejectItems, edges_of
from checkweigher_dsp.rejection.limits import judge
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.stations import route

# What has no reject time is waited for so long: when it would be too late is not known.
_PATIENCE = NANOSECONDS // 10
_PATIENCE_GIVEN_UP = NANOSECONDS
_MAX_AHEAD = 1_000  # far more than a driver has on their way, see FlowControl


class RejectStage:
    """Give every item one verdict: by its mass, or a FAULT when none came in time.

    An estimate is matched with the item that the eyes showed by its stamps, not by its number: a
    segmenter that was started again counts from 1. Edges and estimates may come in any order.

    The methods take the time at which something came, in ns on any clock that never steps back.
    An item's time runs from the arrival of its t3 edge, or if that was held up on its way, from
    when it should have come. One that never gets there is given up by the rule of the segmenter,
    once that time has gone by: nothing more has to come for it. Without a time nothing is ever
    overdue: the result is then one of stamps alone.

    Parameters
    ----------
    parameters : RejectParameters
        Limits and where the rejector stands.
    weigh_length : float, optional
        m, between the eyes. Edges that come before it is known are kept.

    Attributes
    ----------
    inspections : Inspections
        What inspection devices have rejected.
    late_estimates : int
        Estimates that came after the verdict on their item, or twice; they change nothing.
    late_verdicts : int
        Verdicts after their reject time.
    unknown_estimates : int
        Estimates of what the eyes never showed; they have no verdict.
    doubted : bool
        Whether edges may be made up: no item that they show can be weighed.
    """

    def __init__(self, parameters: RejectParameters, weigh_length: float | None = None) -> None:
        self._parameters = parameters
        self.inspections = Inspections(parameters)
        self._stations = parameters.all_stations()
        self.late_estimates = 0
        self.late_verdicts = 0
        self.unknown_estimates = 0
        self.doubted = False
        self._eyes = EyeItems(parameters, weigh_length)
        self._items = RejectItems()
        self._batches = BatchRules()
        self._ahead: list[MassEstimate] = []  # whose edges have not come yet

    @property
    def parameters(self) -> RejectParameters:
        """Limits and places, which may be replaced between two items."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: RejectParameters) -> None:
        self._parameters = self.inspections.parameters = self._eyes.parameters = parameters
        self._stations = parameters.all_stations()

    @property
    def due(self) -> int | None:
        """Time at which time alone brings something next, on the clock of the arguments."""
        times = [item.due for item in self._items.pending]
        times += [self.inspections.due, self._eyes.next_missing]
        return min((time for time in times if time is not None), default=None)

    @property
    def weigh_length(self) -> float | None:
        """Distance between the eyes, m; `set_weigh_length` changes it."""
        return self._eyes.weigh_length

    def set_weigh_length(self, weigh_length: float, now: int | None = None) -> None:
        """Take the distance between the eyes, m; with a change of it a new stream begins."""
        if weigh_length == self.weigh_length:
            return
        self.restart(now)
        for edge, came in self._eyes.set_weigh_length(weigh_length):
            self._follow(edge, came)

    def restart(self, now: int | None = None) -> None:
        """Begin a new stream: what is on the belt will not reach the outfeed eye in it."""
        reason = Reason.FOREIGN_PUBLISHER if self.doubted else Reason.SOURCE_RESTARTED
        for item in self._eyes.begin_stream(reason):
            self._see(item, now)
        self._items.restart()
        self.inspections.restart()

    def take(self, record: EyeEdge | MassEstimate, now: int | None = None) -> list[Verdict]:
        """Take an edge or an estimate and return the verdicts that it brings."""
        if isinstance(record, EyeEdge):
            return self.add_edge(record, now)
        return self.add_estimate(record, now)

    def add_edge(self, edge: EyeEdge, now: int | None = None) -> list[Verdict]:
        """Take an edge of the eyes of the weigh belt and return the verdicts that are due."""
        if self._eyes.keep_early(edge, now):
            return []
        if self._eyes.goes_back(edge):
            if self._eyes.hold_known(edge, now):
                return self._play_again(now)
            self.restart(now)
        self._follow(edge, now)
        arrived = self._take_arrived()
        caught_up = [verdict for each in arrived for verdict in self.add_estimate(each, now)]
        return [*caught_up, *self.advance(now)]

    def _follow(self, edge: EyeEdge, now: int | None) -> None:
        """Take an edge of this stream."""
        came, items = self._eyes.follow(edge, now)
        for item in items:
            self._see(item, came)

    def _play_again(self, now: int | None) -> list[Verdict]:
        """Pass over old edges that come again, unless so many do that all are played again."""
        again = self._eyes.played_again()
        if not again:
            return self.advance(now)
        self.restart(now)
        return [verdict for edge, came in again for verdict in self.add_edge(edge, came)]

    def add_estimate(self, estimate: MassEstimate, now: int | None = None) -> list[Verdict]:
        """Take an estimate and return the verdict on its item, if there was none yet.

        One of what the eyes have not shown waits for its edges; if they never come, no product was
        there, and there is no verdict. One of a segmenter that was started with the item on the
        belt waits for its t3, without which the verdict would have no reject time.
        """
        self._eyes.learn_transit(estimate)
        item = self._items.find_pending(estimate)
        if item is not None and item.held is not None:
            self.late_estimates += 1
            return []
        if item is None:
            if self._items.has_judged(estimate):
                self.late_estimates += 1
                return []
            if self._is_ahead(estimate):
                self._wait_for_edges(estimate)
                return []
            if not self._eyes.knows_any(edges_of(estimate).values()):
                self.unknown_estimates += 1
                return []
            item = RejectItem(estimate.t1, estimate.t2, estimate.t3)
            self._items.pending.append(item)
        if self.doubted or Reason.FOREIGN_PUBLISHER in item.reasons:
            estimate = foreign(estimate)
        verdict = judge(estimate, self.parameters)
        if self._awaits_inspection(item, verdict, now):
            item.held = verdict, estimate
            return []
        return [self._give(item, verdict, now, estimate)]

    def external_reject(self, reject: ExternalReject, now: int) -> None:
        """Take a reject by an inspection device, which came at `now`."""
        self.inspections.add(reject, self.weigh_length, now)

    def _awaits_inspection(self, item: RejectItem, verdict: Verdict, now: int | None) -> bool:
        """Have a verdict wait until all devices have answered; False if it has not to.

        It waits no longer than the rejector lets it.
        """
        over = self.inspections.over_at(_passage(item, verdict), self.weigh_length)
        ready = None if over is None else self._eyes.arrivals.at(over)
        if now is None or ready is None or ready <= now:
            return False
        if item.late_from is None:  # its mass was faster than its edges
            came = None if verdict.t3 is None else self._eyes.arrivals.at(verdict.t3)
            self._set_deadline(item, came, verdict.t3, verdict.reject_at)
        item.ready = ready
        item.due = ready if item.due is None else min(item.due, ready)
        return item.due > now

    def _set_deadline(
        self, item: RejectItem, came: int | None, t3: int | None, reject_at: int | None
    ) -> bool:
        """Set when the verdict on an item is due and late, by when its t3 came; tell if we can."""
        if came is None or t3 is None or reject_at is None:
            return False
        item.late_from = came + reject_at - t3
        margin = round(NANOSECONDS * self.parameters.verdict_margin)
        item.due = item.late_from - margin - self._lead(t3, reject_at)
        return True

    def _lead(self, t3: int, reject_at: int) -> int:
        """Return by how much a station has to be told before the rejector, ns."""
        known = self.parameters
        travel = (reject_at - t3) / NANOSECONDS + known.actuator_delay
        if not self._stations:
            return 0
        return known.earliest_lead(known.rejector_distance / travel if travel > 0 else math.nan)

    def advance(self, now: int | None) -> list[Verdict]:
        """Return the verdicts that can wait no longer."""
        overdue = []
        if now is not None:
            for missing in self._eyes.expire(now):
                self._see(missing, now)
            pending = self._items.pending
            overdue = [item for item in pending if item.due is not None and item.due <= now]
        overdue += [item for item in self._items.too_many() if item not in overdue]
        verdicts = self._give_up(overdue, now)
        if now is not None:
            self.inspections.advance(now)  # after the verdicts that have waited for it
        return verdicts

    def stop(self, now: int | None = None) -> list[Verdict]:
        """Give each item that the eyes have shown its verdict: no mass is waited for any more."""
        for item in self._eyes.give_up(Reason.NO_ESTIMATE):
            self._see(item, now)
        self.restart(now)
        self._eyes.forget_latest()
        return self._give_up(list(self._items.pending), now)

    def number_after(self, last_number: int) -> None:
        """Give no number up to that one, which a stage before this one has given."""
        self._items.recall((), last_number)

    def end_stream(self, edges: Iterable[Arrival], now: int | None = None) -> list[Verdict]:
        """Judge what the edges of a stream that is over show: no mass of it is waited for."""
        verdicts = [verdict for edge, came in edges for verdict in self.add_edge(edge, came)]
        self.restart(now)
        verdicts += self._give_up(list(self._items.pending), now)
        self._items.restart()  # after the last of these is judged
        self._eyes.forget_latest()
        return verdicts

    def recall(
        self, history: LineHistory, live: Iterable[Arrival] = (), now: int | None = None,
        *, over: Iterable[Arrival] = (),
    ) -> list[Verdict]:  # fmt: skip
        """Take the driver's history, with the verdicts of stages that judged before this one.

        An item that had passed the eyes by then and has no verdict is a FAULT now: no stage took
        its mass. One that is still on the belt goes on as usual. `live` are the edges that have
        come and were kept back until now, each with its time, and `over` those of streams before
        that of the history; `now` in ns.
        """
        self._items.recall(history.verdicts, history.last_item_id)
        for verdict in history.verdicts:
            self._batches.remember(BatchTally.of(verdict))
        verdicts = self.end_stream(over, now) if over else []
        missed, live = self._eyes.missed(history, live)
        if missed:
            self._items.pending.clear()  # they are found again, with all their edges
            self._eyes.count_again()
            for edge in missed:
                self._follow(edge, None)
            ago = history.stamp - max(edge.stamp for edge in missed)
            self._eyes.caught_up(None if now is None else now - ago)
            if history.first_edge:
                self._forget_cut(missed[0].stamp)
            for item in self._items.pending:
                if now is not None and item.reject_at is not None:
                    item.late_from = now + item.reject_at - history.stamp
            verdicts += self._give_up(list(self._items.pending), now)
        for edge, came in live:
            verdicts += self.add_edge(edge, came)
        return verdicts

    def _forget_cut(self, begin: int) -> None:
        """Forget items whose first edges the history lacks: the oldest, long past the rejector."""
        assert self.weigh_length is not None
        end = begin + self.parameters.max_transit(self.weigh_length)
        self._items.pending = [
            item
            for item in self._items.pending
            if item.t1 is not None or min(edges_of(item).values(), default=begin) > end
        ]

    def _give_up(self, items: Sequence[RejectItem], now: int | None) -> list[Verdict]:
        """Return the verdicts on items whose mass is waited for no more."""
        verdicts = []
        for item in items:
            if item.held is not None:
                verdict, estimate = item.held
                verdicts.append(self._give(item, verdict, now, estimate))
            elif self._items.is_used_up(item):
                self._items.pending.remove(item)  # it has its verdict under other edges
            else:
                verdicts.append(self._give(item, self._without_estimate(item), now))
        return verdicts

    def _see(self, seen: Item, now: int | None) -> None:
        """Take an item that the eyes are done with; its verdict may have been faster."""
        if self._items.has_seen(seen):
            return
        reasons = tuple(reason.value for reason in seen.faults)
        if self.doubted:
            reasons = (Reason.FOREIGN_PUBLISHER.value, *reasons)
        if (held := self._items.find_held(seen)) is not None:
            held.count, held.reasons = seen.item_id, reasons
            return
        item = RejectItem(seen.t1, seen.t2, seen.t3, count=seen.item_id, reasons=reasons)
        item.reject_at = self.parameters.reject_time(
            seen.t3, self._eyes.speed(seen.t1, seen.t3, seen.usual_transit)
        )
        if now is not None and not self._set_deadline(item, now, seen.t3, item.reject_at):
            item.due = now + (_PATIENCE_GIVEN_UP if seen.t3 is None else _PATIENCE)
        self._items.pending.append(item)

    def _is_ahead(self, estimate: MassEstimate) -> bool:
        """Tell whether edges that may yet come show more of the item of an estimate."""
        stamps = edges_of(estimate).values()
        if self._eyes.knows_any(stamps):
            return self._eyes.is_entry_unseen(estimate)
        return bool(stamps) and self._eyes.may_come(max(stamps))

    def _take_arrived(self) -> list[MassEstimate]:
        """Take the estimates that are no longer ahead."""
        waiting, self._ahead = self._ahead, []
        arrived: list[MassEstimate] = []
        for estimate in waiting:
            (self._ahead if self._is_ahead(estimate) else arrived).append(estimate)
        return arrived

    def _wait_for_edges(self, estimate: MassEstimate) -> None:
        """Keep an estimate that is ahead of its edges."""
        self._ahead.append(estimate)
        if len(self._ahead) > _MAX_AHEAD:
            del self._ahead[0]
            self.unknown_estimates += 1

    def _without_estimate(self, item: RejectItem) -> Verdict:
        test = (Reason.PERFORMANCE_TEST.value,) if self.parameters.performance_test else ()
        return Verdict(
            0,
            item.t3,
            Decision.FAULT,
            tuple(dict.fromkeys((*test, *item.reasons, Reason.NO_ESTIMATE.value))),
            lower_limit=self.parameters.lower_limit,
            upper_limit=self.parameters.upper_limit,
            reject_at=item.reject_at,
            t1=item.t1,
        )

    def _give(
        self, item: RejectItem, verdict: Verdict, now: int | None,
        estimate: MassEstimate | None = None,
    ) -> Verdict:  # fmt: skip
        late_from = item.late_from
        if late_from is None and verdict.reject_at is not None:
            # Its mass was faster than its edges.
            late_from = self._eyes.arrivals.at(verdict.reject_at)
        number = self._items.judge(item, estimate, verdict.estimate_id)
        t1, t3, reject_at = verdict.t1, verdict.t3, verdict.reject_at
        # A segmenter that was started again has not seen all edges of its first item. Which edges
        # are its own is not known of an item that is a fault by its edges.
        if item.count is not None and not item.reasons:
            t1 = item.t1 if t1 is None else t1
            t3 = item.t3 if t3 is None else t3
            reject_at = item.reject_at if reject_at is None else reject_at
        verdict = replace(verdict, t1=t1, t3=t3, reject_at=reject_at)
        passage = _passage(item, verdict)
        over = None if now is None else item.ready is None or item.ready <= now
        verdict = self.inspections.heed(verdict, passage, self.weigh_length, over=over)
        verdict = self._batches.judge(verdict, self.parameters, item_id=number)
        routed = route(verdict, self._stations, self._eyes.speed(verdict.t1, verdict.t3))
        if late_from is not None and routed.station_at is not None and reject_at is not None:
            late_from += routed.station_at - reject_at
        late = now is not None and late_from is not None and now > late_from
        self.late_verdicts += late
        verdict = replace(routed, late=late)
        self.inspections.judged(verdict, passage)
        return verdict


def _passage(item: RejectItem, verdict: Verdict) -> Passage | None:
    """Return the way of an item over the weigh belt, None if an edge of it is not known."""
    t1, t3 = verdict.t1, verdict.t3
    if t1 is None or t3 is None or item.t2 is None:
        return None
    return Passage(t1, item.t2 - t1, t3 - t1)
