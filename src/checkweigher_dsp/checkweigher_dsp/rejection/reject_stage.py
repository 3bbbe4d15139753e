# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The verdict on each item, and the time by which the rejector needs it.

The segmenter announces the items, with their numbers. An item whose mass does not come, because a
stage hangs or has died, is a FAULT in time for the rejector.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace
import math

from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    EyeEdge,
    Item,
    MassEstimate,
    ProductOnLine,
    StreamStatus,
    Verdict,
)
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.rejection.batch_rules import BatchRules
from checkweigher_dsp.rejection.inspections import Inspections, Passage
from checkweigher_dsp.rejection.items import PendingItem, PendingItems
from checkweigher_dsp.rejection.limits import judge
from checkweigher_dsp.rejection.outfeed_watch import OutfeedEdge, OutfeedWatch
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.stations import route
from checkweigher_dsp.rejection.timing import ArrivalClock

# Times in ns.
_PATIENCE = NANOSECONDS // 10  # for the mass of an item without a reject time
_PATIENCE_GIVEN_UP = NANOSECONDS  # for the mass of an item that the segmenter has given up
# For an announcement; longer than a segmenter waits for stalled samples.
_PATIENCE_UNTAKEN = 3 * NANOSECONDS // 10
_PATIENCE_UNHEARD = 5 * NANOSECONDS  # for the first announcement, or that of an estimate
_MAX_WATCHED = 1_000


class RejectStage:
    """Stage that gives every announced item one verdict, a FAULT if its mass does not come in time.

    Announcements, edges and estimates may come in any order; an estimate waits for the
    announcement of its item. The argument `now` of the methods is the time of arrival, in ns of any
    clock that never steps back. The time of an item runs from the undelayed arrival of its t3 edge.
    Without `now` nothing is ever overdue, and the verdicts depend on stamps alone.

    An item that leaves while the segmenter is dead or behind is a FAULT at its deadline. It is the
    oldest announced item that has not left, or else an item with the next free number.

    Parameters
    ----------
    parameters : RejectParameters
        Places and times, and the limits while there is no product.
    weigh_length : float, optional
        Distance between the eyes in m.
    judged : iterable of int
        Numbers of items that have a verdict by a stage before this one.

    Attributes
    ----------
    weigh_length : float or None
        Distance between the eyes in m.
    inspections : Inspections
        Rejects by inspection devices.
    late_estimates : int
        Number of estimates that came after the verdict on their item, or twice, and were dropped.
    late_items : int
        Number of announcements that came after the verdict on their item, and were dropped.
    unknown_estimates : int
        Number of estimates of items that were never announced, and have no verdict.
    foreign : bool
        Whether edges and estimates may come from a stranger. Each verdict is then a FAULT.
    out_of_numbers : bool
        Whether an item has left that can have no number of its own. The line then has to stop.
    """

    def __init__(
        self,
        parameters: RejectParameters,
        weigh_length: float | None = None,
        judged: Iterable[int] = (),
    ) -> None:
        self._parameters = parameters
        self.weigh_length = weigh_length
        self._product: ProductOnLine | None = None
        self.inspections = Inspections(parameters)
        self.late_estimates = 0
        self.late_items = 0
        self.unknown_estimates = 0
        self.foreign = self.out_of_numbers = False
        self._line_speed = math.nan  # m/s, of the last item
        self._newest = 0  # stamp of the samples that the segmenter has, ns
        self._heard: int | None = None  # arrival of the first announcement
        self._items = PendingItems(judged)
        self._batches = BatchRules()
        self._arrivals = ArrivalClock()
        self._watch = OutfeedWatch()
        # t1 and t3 of verdicts on items that the segmenter had not completed.
        self._watched: deque[tuple[int | None, int | None]] = deque(maxlen=_MAX_WATCHED)
        self._own_numbers: deque[int] = deque(maxlen=_MAX_WATCHED)  # of items never announced
        # Estimates of items that are not complete, with the time until which to wait for them.
        self._early: dict[int, tuple[MassEstimate, int | None]] = {}

    @property
    def parameters(self) -> RejectParameters:
        """Places and times; may be replaced between two items."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: RejectParameters) -> None:
        self._parameters = self.inspections.parameters = parameters

    @property
    def product(self) -> ProductOnLine:
        """Limits and batch of the items; may be replaced between two items."""
        return self._product or self._parameters.limits

    @product.setter
    def product(self, product: ProductOnLine) -> None:
        self._product = product

    @property
    def due(self) -> int | None:
        """Time of the next call of `advance`, on the clock of arrivals; None if none is needed."""
        times = [item.due for item in self._items.pending.values()]
        times += [self._deadline(edge)[0] for edge in self._watch.open]
        times += [patience for _, patience in self._early.values()]
        times.append(self.inspections.due)
        return min((time for time in times if time is not None), default=None)

    def restart(self) -> None:
        """Begin a new stream, in which the same stamps may come again."""
        self._arrivals = ArrivalClock()
        self._watch.restart()
        self._watched.clear()
        self._newest = 0
        self.inspections.judged.clear()

    def take(self, record: Item | EyeEdge | MassEstimate, now: int | None = None) -> list[Verdict]:
        """Process a record and return the verdicts that follow."""
        if isinstance(record, Item):
            return self.add_item(record, now)
        if isinstance(record, EyeEdge):
            self.add_edge(record, now)
            return self.advance(now)
        return self.add_estimate(record, now)

    def add_edge(self, edge: EyeEdge, now: int | None = None) -> None:
        """Add an edge of the eyes of the weigh belt."""
        if now is not None:
            came = self._arrivals.came(edge.stamp, now)
            self._watch.add(edge, came, self._items.largest)

    def hear_segmenter(self, status: StreamStatus) -> None:
        """Remove the edges that the segmenter has taken from the watch."""
        self._newest = status.stamp
        if status.last_edge is not None:
            self._watch.take_to(status.last_edge, status.edges)

    def add_item(self, item: Item, now: int | None = None) -> list[Verdict]:
        """Add an announcement and return the verdicts that follow."""
        if self._heard is None:
            self._heard = now
        watched = self._was_watched(item)
        if watched and not self._items.has_verdict(item.item_id):
            self._items.pass_over(item.item_id)
        pending = self._items.announce(item)
        if not math.isnan(item.line_speed):
            self._line_speed = item.line_speed
        if not item.complete:
            return []
        self._watch.explain(item.t3)
        if pending is None:
            self.late_items += 1
            self.out_of_numbers |= item.item_id in self._own_numbers and not watched
            return []
        self._set_times(pending, now)
        verdicts = self._judge_lost(pending, now)
        estimate, _ = self._early.pop(item.item_id, (None, None))
        if estimate is not None:
            verdicts += self.add_estimate(estimate, now)
        return verdicts

    def take_passed_over(self) -> list[int]:
        """Return the numbers since the last call whose items have a verdict under another one."""
        found, self._items.passed_over = self._items.passed_over, []
        return found

    def _judge_lost(self, leaving: PendingItem, now: int | None) -> list[Verdict]:
        """Return the verdicts on items before one that leaves, whose segmenter was killed.

        Items leave in the order in which they enter. The segmenter that was started again may have
        seen the oldest of them leave, without having seen it enter.
        """
        if leaving.item.t3 is None or now is None:
            return []
        lost = self._items.on_belt(leaving.item.item_id)
        if lost and leaving.item.t1 is None:
            oldest, *_ = lost
            oldest.item = replace(oldest.item, t3=leaving.item.t3)
            oldest.reject_at, oldest.late_from = leaving.reject_at, leaving.late_from
            self._items.pass_over(leaving.item.item_id)
            self.late_items += 1
            lost = [oldest]
        return [self._give_up(each, now) for each in lost]

    def _was_watched(self, item: Item) -> bool:
        """Return whether an item had its verdict by its edges before its announcement."""
        return any(
            (item.t1 is not None and item.t1 == t1) or (item.t3 is not None and item.t3 == t3)
            for t1, t3 in self._watched
        )

    def add_estimate(self, estimate: MassEstimate, now: int | None = None) -> list[Verdict]:
        """Add an estimate and return the verdict on its item, if there was none yet."""
        pending = self._items.pending.get(estimate.item_id)
        if self._items.has_verdict(estimate.item_id) or (pending and pending.held):
            self.late_estimates += 1
            return []
        if pending is None or not pending.item.complete:
            patience = None if now is None else now + _PATIENCE_UNHEARD
            self._early[estimate.item_id] = estimate, patience
            return []
        verdict = judge(estimate, self.parameters, self.product)
        if self._awaits_inspection(pending, now):
            pending.held = verdict
            return []
        return [self._give(pending, verdict, now)]

    def _awaits_inspection(self, item: PendingItem, now: int | None) -> bool:
        """Return whether the verdict on an item waits for the devices, and set until when.

        It waits until all devices have answered, but not beyond the deadline of the item.
        """
        over = self.inspections.over_at(self._passage(item.item))
        ready = None if over is None else self._arrivals.at(over)
        if now is None or ready is None or ready <= now:
            return False
        item.ready = ready
        item.due = ready if item.due is None else min(item.due, ready)
        return item.due > now

    def _set_times(self, pending: PendingItem, now: int | None) -> None:
        """Set the times of the verdict on a complete item."""
        item = pending.item
        pending.reject_at = self.parameters.reject_time(item.t3, item.line_speed)
        if now is None:
            return
        came = self._watch.came(item.t3)
        if came is None and item.t3 is not None:
            came = self._arrivals.at(item.t3)
        if came is None or item.t3 is None or pending.reject_at is None:
            pending.due = now + (_PATIENCE_GIVEN_UP if item.t3 is None else _PATIENCE)
            return
        pending.late_from = came + pending.reject_at - item.t3
        pending.due = pending.late_from - self._head_start(item.t3, pending.reject_at)

    def _head_start(self, t3: int, reject_at: int) -> int:
        """Return the time in ns by which a verdict has to come before its reject time."""
        known = self.parameters
        travel = (reject_at - t3) / NANOSECONDS + known.actuator_delay
        speed = known.rejector_distance / travel if travel > 0 else math.nan
        return round(NANOSECONDS * known.verdict_margin) + known.earliest_lead(speed)

    def _deadline(self, edge: OutfeedEdge) -> tuple[int, int | None]:
        """Return the deadline of a verdict by an outfeed edge, and its reject time if known; ns.

        A stage that has just been started waits for the latched announcements.
        """
        if self._heard is None:
            return edge.came + _PATIENCE_UNHEARD, None
        history = self._heard + _PATIENCE_UNTAKEN
        oldest = self._entered_before(edge.stamp)
        speed = math.nan if oldest is None else self._speed(oldest.item.t1, edge.stamp)
        reject_at = self.parameters.reject_time(
            edge.stamp, self._line_speed if math.isnan(speed) else speed
        )
        if reject_at is None:
            return max(edge.came + _PATIENCE_UNTAKEN, history), None
        late_from = edge.came + reject_at - edge.stamp
        due = late_from - self._head_start(edge.stamp, reject_at)
        return max(due, history), reject_at

    def advance(self, now: int | None) -> list[Verdict]:
        """Return the verdicts that can wait no longer."""
        if now is None:
            return []
        pending = self._items.pending.values()
        overdue = [item for item in pending if item.due is not None and item.due <= now]
        verdicts = [self._give_up(item, now) for item in overdue]
        verdicts += self._judge_unannounced(now)
        self._forget_unknown(now)
        self.inspections.advance(now)  # after the verdicts that have waited for it
        return verdicts

    def _judge_unannounced(self, now: int) -> list[Verdict]:
        """Return the verdicts on items that have left without an announcement."""
        verdicts = []
        for edge in self._watch.open:
            due, reject_at = self._deadline(edge)
            if due > now:
                continue
            self._watch.remove(edge.stamp)
            pending = self._entered_before(edge.stamp)
            if pending is None:
                number = self._items.free_number(edge.after)
                if number is None:
                    self.out_of_numbers = True
                    continue
                self._own_numbers.append(number)
                pending = PendingItem(Item(edge.stamp, 0, number))
            pending.item = replace(pending.item, t3=edge.stamp, complete=True)
            pending.reject_at = reject_at
            if reject_at is not None:
                pending.late_from = edge.came + reject_at - edge.stamp
            self._watched.append((pending.item.t1, edge.stamp))
            verdicts.append(self._give_up(pending, now))
        return verdicts

    def _entered_before(self, stamp: int) -> PendingItem | None:
        """Return the oldest item that was on the belt before a stamp, None if there is none."""
        on_belt = self._items.on_belt()
        return next((each for each in on_belt if (each.item.stamp or 0) < stamp), None)

    def _forget_unknown(self, now: int) -> None:
        """Drop the estimates whose items were not announced in time."""
        for number, (_, patience) in list(self._early.items()):
            if patience is not None and patience <= now:
                del self._early[number]
                self.unknown_estimates += 1

    def judge_complete(self, now: int | None = None) -> list[Verdict]:
        """Return the verdicts on complete items, whose masses may have been missed."""
        pending = list(self._items.pending.values())
        return [self._give_up(each, now) for each in pending if each.item.complete]

    def stop(self, now: int | None = None) -> list[Verdict]:
        """Return the verdicts on all announced items, without waiting for their masses."""
        self.restart()
        self._early.clear()
        self._watch.open.clear()
        return [self._give_up(each, now) for each in list(self._items.pending.values())]

    def _give_up(self, item: PendingItem, now: int | None) -> Verdict:
        """Return the verdict on an item without waiting for its mass any more."""
        verdict = item.held or self._without_estimate(item)
        return self._give(item, verdict, now)

    def _without_estimate(self, pending: PendingItem) -> Verdict:
        item = pending.item
        test = (Reason.PERFORMANCE_TEST.value,) if self.product.performance_test else ()
        return Verdict(
            item.item_id,
            item.t3,
            Decision.FAULT,
            tuple(dict.fromkeys((*test, *item.reasons, Reason.NO_ESTIMATE.value))),
            lower_limit=self.product.lower_limit,
            upper_limit=self.product.upper_limit,
            reject_at=pending.reject_at,
            t1=item.t1,
        )

    def _give(self, pending: PendingItem, verdict: Verdict, now: int | None) -> Verdict:
        """Return the final verdict, after inspection devices, batch rules and stations."""
        self._items.judge(verdict.item_id)
        if self.foreign:
            verdict = _refused(verdict)
        passage = self._passage(pending.item)
        over = None if now is None else pending.ready is None or pending.ready <= now
        verdict = self.inspections.heed(verdict, passage, over)
        verdict = self._batches.judge(verdict, self.product)
        speed = self._speed(verdict.t1, verdict.t3)
        verdict = route(verdict, self.parameters.all_stations, speed)
        verdict = replace(verdict, late=self._is_late(verdict, pending.late_from, now))
        self.inspections.judged.append((verdict, passage))
        return verdict

    def _is_late(self, verdict: Verdict, late_from: int | None, now: int | None) -> bool:
        """Return whether a verdict comes too late for its rejector or station."""
        if now is None:
            return False
        reject_at = verdict.reject_at
        if reject_at is None:
            return late_from is not None and now > late_from
        if late_from is None:
            late_from = self._arrivals.at(reject_at)
        if late_from is None:  # in a stage that has just been started
            return reject_at < self._newest
        lead = reject_at - verdict.station_at if verdict.station_at else 0
        return now > late_from - lead

    def _speed(self, t1: int | None, t3: int | None) -> float:
        """Return the belt speed by the edges of an item in m/s, NaN if one is not known."""
        if t1 is None or t3 is None or t3 <= t1 or self.weigh_length is None:
            return math.nan
        return self.weigh_length * NANOSECONDS / (t3 - t1)

    def _passage(self, item: Item) -> Passage | None:
        """Return the way of an item over the weigh belt, None if a part of it is not known."""
        if item.t1 is None or item.t2 is None or item.t3 is None or not self.weigh_length:
            return None
        return Passage(item.t1, item.t2 - item.t1, item.t3 - item.t1, self.weigh_length)


def _refused(verdict: Verdict) -> Verdict:
    """Return a verdict as a FAULT without a mass, because its data may come from a stranger."""
    reasons = tuple(dict.fromkeys((Reason.FOREIGN_PUBLISHER.value, *verdict.reasons)))
    nan = math.nan
    return replace(verdict, decision=Decision.FAULT, reasons=reasons, mass=nan, std_dev=nan)
