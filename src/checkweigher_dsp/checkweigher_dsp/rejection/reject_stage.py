# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reject stage, which gives a verdict on each item in time for the rejector.

The segmenter announces each item by an `Item` record. If the mass of an item does not arrive,
because a stage hangs or has ended, the item becomes a FAULT in time for the rejector.
"""

from collections.abc import Iterable
from dataclasses import replace

from checkweigher_core.records import EyeEdge, Item, MassEstimate, StreamStatus, Verdict
from checkweigher_dsp.rejection.batch_rules import BatchRules
from checkweigher_dsp.rejection.deadlines import PATIENCE_UNHEARD, Deadlines
from checkweigher_dsp.rejection.inspections import Inspections, Passage
from checkweigher_dsp.rejection.items import EarlyEstimates, PendingItem, PendingItems
from checkweigher_dsp.rejection.limits import judge, refused, without_estimate
from checkweigher_dsp.rejection.outfeed_watch import OutfeedEdge, OutfeedWatch
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.stations import route
from checkweigher_dsp.rejection.timing import belt_speed


class RejectStage:
    """Stage that gives one verdict on each item, in time for the rejector.

    An item whose mass does not arrive in time is a FAULT.

    Announcements, edges and estimates may arrive in any order, because an estimate waits for the
    announcement of its item. The argument `now` of the methods is the time of arrival in ns on a
    monotonic clock. The deadline of an item is computed from the time at which its outfeed edge
    would have arrived without a transmission delay. If `now` is None, no item has a deadline, and
    the verdicts depend only on time stamps.

    If an item leaves while the segmenter is delayed or has ended, the oldest announced item on the
    belt becomes a FAULT at the deadline. If no announced item is on the belt, the FAULT has the
    next free item number.

    `judged` are the numbers of items that received their verdict from an earlier process.
    """

    def __init__(
        self,
        parameters: RejectParameters,
        weigh_length: float | None = None,
        judged: Iterable[int] = (),
    ) -> None:
        self.weigh_length = weigh_length  # distance between the eyes in m
        self.product = parameters.limits  # limits and batch, which may be replaced between items
        self.inspections = Inspections(parameters)
        self.items = PendingItems(judged)
        self.early = EarlyEstimates()
        # Number of estimates, and number of announcements, that were repeated or arrived after the
        # verdict.
        self.late_estimates = self.late_items = 0
        # Whether a foreign node may have sent edges or estimates. While `foreign` is true, each
        # verdict is a FAULT.
        self.foreign = False
        # Whether an item has left for which no number is free, or whose number was used before.
        # If `out_of_numbers` is true, the caller must stop the line and clear the flag.
        self.out_of_numbers = False
        self._batches = BatchRules()
        self._deadlines = Deadlines(parameters)
        self._watch = OutfeedWatch()

    @property
    def parameters(self) -> RejectParameters:
        """Parameters of the stage, which may be replaced between two items."""
        return self._deadlines.parameters

    @parameters.setter
    def parameters(self, parameters: RejectParameters) -> None:
        self.inspections.parameters = self._deadlines.parameters = parameters
        if not self.product.stamp:
            self.product = parameters.limits

    @property
    def due(self) -> int | None:
        """Time on the clock of arrivals at which `advance` must be called, or None."""
        times = [item.due for item in self.items.pending.values()]
        times += [self._deadline(edge)[0] for edge in self._watch.open]
        times += [self.early.due, self.inspections.due]
        return min((time for time in times if time is not None), default=None)

    def restart(self) -> None:
        """Begin a new stream, in which stamps may be repeated."""
        self._deadlines.restart()
        self._watch.restart()
        self.inspections.judged.clear()

    def take(
        self, record: Item | EyeEdge | MassEstimate | StreamStatus, now: int | None = None
    ) -> list[Verdict]:
        """Add a record or a status of the segmenter, and return the verdicts that it causes.

        Verdicts that are due because of their deadline are returned by `advance`. If `now` is None,
        an edge is ignored.
        """
        if isinstance(record, Item):
            return self._add_item(record, now)
        if isinstance(record, MassEstimate):
            return self._add_estimate(record, now)
        if isinstance(record, StreamStatus):
            self._deadlines.newest = record.stamp
            if record.last_edge is not None:
                self._watch.take_to(record.last_edge, record.edges)
        elif now is not None:
            self._watch.add(record, self._deadlines.add_edge(record, now), self.items.largest)
        return []

    def _add_item(self, item: Item, now: int | None) -> list[Verdict]:
        self._deadlines.add_item(item, now)
        watched = self._watch.has_judged(item)
        if watched and not self.items.has_verdict(item.item_id):
            self.items.pass_over(item.item_id)
        pending = self.items.announce(item)
        if not item.complete:
            return []
        self._watch.explain(item.t3)
        if pending is None:
            self.late_items += 1
            number = item.item_id
            # Detect a segmenter that has lost its numbers and uses some of them again.
            again = not self.items.judged_here(number) and self._watch.has_seen(item.t3)
            self.out_of_numbers |= not watched and (again or self.items.is_own(number))
            return []
        self._deadlines.set(pending, now)
        verdicts = self._judge_lost(pending, now)
        estimate = self.early.take(item.item_id)
        return verdicts if estimate is None else verdicts + self._add_estimate(estimate, now)

    def _judge_lost(self, leaving: PendingItem, now: int | None) -> list[Verdict]:
        """Return the verdicts on lost items, which were on the belt ahead of a leaving item.

        Items leave in the order of their entry. So if an earlier item still seems to be on the
        belt, the segmenter has lost this item by a restart. If t1 of the leaving item is unknown,
        the leaving item is assumed to be the oldest lost item, and only this item gets a verdict.
        If t3 of the leaving item is unknown or `now` is None, there are no verdicts.
        """
        if leaving.item.t3 is None or now is None:
            return []
        lost = self.items.on_belt(leaving.item.item_id)
        if lost and leaving.item.t1 is None:
            oldest, *_ = lost
            oldest.item = replace(oldest.item, t3=leaving.item.t3)
            oldest.reject_at, oldest.late_from = leaving.reject_at, leaving.late_from
            self.items.pass_over(leaving.item.item_id)
            self.late_items += 1
            lost = [oldest]
        return [self._give(each, now) for each in lost]

    def _add_estimate(self, estimate: MassEstimate, now: int | None) -> list[Verdict]:
        pending = self.items.pending.get(estimate.item_id)
        if self.items.has_verdict(estimate.item_id) or (pending and pending.by_mass):
            self.late_estimates += 1
            return []
        if pending is None or not pending.item.complete:
            self.early.add(estimate, None if now is None else now + PATIENCE_UNHEARD)
            return []
        pending.by_mass = judge(estimate, self.parameters, self.product)
        over = self.inspections.over_at(Passage.of(pending.item, self.weigh_length))
        waits = self._deadlines.await_devices(pending, over, now)
        return [] if waits else [self._give(pending, now)]

    def advance(self, now: int | None) -> list[Verdict]:
        """Return the verdicts that are due, and remove the expired estimates and rejects.

        If `now` is None, no verdict is due, and nothing expires.
        """
        if now is None:
            return []
        pending = self.items.pending.values()
        overdue = [item for item in pending if item.due is not None and item.due <= now]
        verdicts = [self._give(item, now) for item in overdue]
        verdicts += self._judge_unannounced(now)
        self.early.advance(now)
        # Remove expired rejects last, because the verdicts that are due may need them.
        self.inspections.advance(now)
        return verdicts

    def _judge_unannounced(self, now: int) -> list[Verdict]:
        """Return the verdicts on items that have left without an announcement."""
        verdicts = []
        for edge in self._watch.open:
            due, reject_at = self._deadline(edge)
            if due > now:
                continue
            self._watch.remove(edge.stamp)
            pending = self.items.entered_before(edge.stamp)
            pending = pending or self.items.unannounced(edge.stamp, edge.after)
            if pending is None:
                self.out_of_numbers = True
                continue
            pending.item = replace(pending.item, t3=edge.stamp, complete=True)
            pending.reject_at = reject_at
            if reject_at is not None:
                pending.late_from = edge.came + reject_at - edge.stamp
            self._watch.judge(pending.item.t1, edge.stamp)
            verdicts.append(self._give(pending, now))
        return verdicts

    def _deadline(self, edge: OutfeedEdge) -> tuple[int, int | None]:
        """Return the deadline and the reject time, in ns, of the item at an outfeed edge."""
        oldest = self.items.entered_before(edge.stamp)
        t1 = None if oldest is None else oldest.item.t1
        return self._deadlines.of_edge(edge, belt_speed(t1, edge.stamp, self.weigh_length))

    def judge_complete(self, now: int | None = None) -> list[Verdict]:
        """Return the verdicts on all waiting items that are complete.

        The items do not wait any longer, because the stage may have missed their masses.
        """
        return [
            self._give(each, now)
            for each in list(self.items.pending.values())
            if each.item.complete
        ]

    def stop(self, now: int | None = None) -> list[Verdict]:
        """Return the verdicts on all announced items, without waiting for their masses.

        The waiting edges and estimates are discarded.
        """
        self.restart()
        self.early.clear()
        self._watch.open.clear()
        return [self._give(each, now) for each in list(self.items.pending.values())]

    def _give(self, pending: PendingItem, now: int | None) -> Verdict:
        """Return the final verdict on an item, after inspections, batch rules and routing."""
        item = pending.item
        self.items.judge(item.item_id)
        verdict = pending.by_mass or without_estimate(item, pending.reject_at, self.product)
        if self.foreign:
            verdict = refused(verdict)
        passage = Passage.of(item, self.weigh_length)
        over = None if now is None else pending.ready is None or pending.ready <= now
        verdict = self.inspections.heed(verdict, passage, over)
        verdict = self._batches.judge(verdict, self.product)
        speed = belt_speed(verdict.t1, verdict.t3, self.weigh_length)
        verdict = route(verdict, self.parameters.all_stations, speed)
        verdict = replace(verdict, late=self._deadlines.is_late(verdict, pending.late_from, now))
        self.inspections.judged.append((verdict, passage))
        return verdict
