# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Monitoring of the rejector, and requests to stop the line."""

from dataclasses import dataclass
from itertools import zip_longest
import math

from checkweigher_core.records import (
    GRAMS,
    NANOSECONDS,
    Decision,
    EyeEdge,
    MachineConditions,
    MassEstimate,
    PerformanceState,
    PerformanceTest,
    StopRequest,
    Verdict,
    ZeroChange,
    seconds,
)
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_dsp.rejection.parameters import RejectParameters

_REASONS = {reason.value: reason for reason in StopReason}

_FAILED_IN_A_ROW = 2  # number of successive items with a failed stage after which the line stops.
# Shortest time in s in which a drift changes the zero by the largest permitted step.
_DRIFT_TIME = 600.0


@dataclass(slots=True, eq=False)
class _Expected:
    """Item that is expected at the rejector."""

    item_id: int
    reject_at: int  # reject time in ns
    rejected: bool
    confirmed: bool = False  # whether the eye behind the rejector has seen the item


class RejectMonitor:
    """Monitor of the rejector, which also collects the other reasons to stop the line.

    The monitor compares the verdicts with the edges of the eye behind the rejector. An edge belongs
    to the item with the nearest reject time if they differ by at most ``confirmation_time``. An
    edge is evaluated as soon as no item with a nearer reject time can follow.
    """

    def __init__(self, parameters: RejectParameters) -> None:
        self.parameters = parameters  # parameters, which may be replaced at any time
        self.request: StopRequest | None = None  # first stop request since the last reset
        self.trouble = ''  # text about a problem of the driver, or empty
        self.conditions = MachineConditions(0, True)
        self.test: PerformanceTest | None = None  # latest state of the performance test, or None
        self.strangers = ''  # text about foreign nodes that publish topics of the line, or empty.
        # Text about an excessive step of the zero, or empty if there was none since the zero was
        # last set on request.
        self.zero_step = ''
        self._zero: tuple[float, int] | None = None  # last zero in kg and its time in ns
        self._in_a_row = self._failed_in_a_row = 0
        self.restart()

    def restart(self) -> None:
        """Discard the edges and items, because their stamps are not valid in a new stream."""
        self._expected: list[_Expected] = []
        self._edges: list[int] = []

    @property
    def due(self) -> int | None:
        """Stamp in ns at which the next edge or item can be evaluated, or None."""
        window = self._window
        times = [stamp + window for stamp in self._edges]
        times += [item.reject_at + 2 * window for item in self._expected]
        return min(times) + 1 if times else None

    def add_verdict(self, verdict: Verdict) -> None:
        """Add a verdict, and request a stop after too many successive rejects or failures.

        A reject during a performance test is not counted. Unless ``confirmation_time`` is 0, the
        item is expected at the eye behind the rejector.
        """
        rejected = verdict.decision is not Decision.ACCEPT
        if Reason.PERFORMANCE_TEST not in verdict.reasons:
            self._in_a_row = _counted_on(self._in_a_row, rejected)
        limit = self.parameters.max_rejects_in_a_row
        if limit and self._in_a_row >= limit:
            self.stop(StopReason.TOO_MANY_REJECTS, verdict.item_id, verdict.reject_at)
        failed = Reason.STAGE_FAILED in verdict.reasons
        self._failed_in_a_row = _counted_on(self._failed_in_a_row, failed)
        if self._failed_in_a_row >= _FAILED_IN_A_ROW:
            self.stop(StopReason.STAGE_FAILED, verdict.item_id, verdict.reject_at)
        # Do not expect an item that a station removes, because it does not reach the eye.
        if self._window and verdict.reject_at is not None and not (rejected and verdict.station):
            self._expected.append(_Expected(verdict.item_id, verdict.reject_at, rejected))

    def add_zero(self, estimate: MassEstimate, tolerance: float) -> None:
        """Request a stop if the zero has changed suddenly since the previous item.

        The limit is the lesser of ``max_zero_step`` and the `tolerance` of the product in kg, plus
        an allowance for drift. If ``max_zero_step`` is 0, no stop is requested. An estimate without
        t1 or without a zero is ignored.
        """
        if estimate.t1 is None or not math.isfinite(estimate.zero):
            return
        before, self._zero = self._zero, (estimate.zero, estimate.t1)
        if before is None or not self.parameters.max_zero_step:
            return
        step = estimate.zero - before[0]
        largest = min(self.parameters.max_zero_step, tolerance)
        if abs(step) > largest * (1 + abs(seconds(estimate.t1 - before[1])) / _DRIFT_TIME):
            self.zero_step = f'{GRAMS * step:+.1f} g before item {estimate.item_id}'
            self.stop(StopReason.ZERO_STEP, estimate.item_id, text=self.zero_step)

    def add_zero_change(self, change: ZeroChange) -> None:
        """Store a zero that was set on request, so that its step does not stop the line."""
        self.zero_step = ''
        self._zero = change.zero, change.stamp

    def add_edge(self, edge: EyeEdge) -> None:
        """Add an edge of the eye behind the rejector.

        Edges that clear the eye are ignored. If ``confirmation_time`` is 0, all edges are ignored.
        """
        if self._window and edge.blocked:
            self._edges.append(edge.stamp)

    def check(self, now: int) -> None:
        """Request a stop if there is a reason that persists until its cause is removed.

        `now` is the time of the system clock in ns. Persistent reasons are problems of the driver,
        conditions of the machine inputs, an overdue or failed performance test, foreign nodes, and
        an excessive step of the zero.
        """
        if self.trouble:
            if self.request is not None and self.request.reason is StopReason.DRIVER_TROUBLE:
                self.request = None  # Replace the request, because its text may have changed.
            self.stop(StopReason.DRIVER_TROUBLE, text=self.trouble)
        if not self.conditions.known:
            self.stop(StopReason.DRIVER_TROUBLE, text='the machine inputs are unknown')
        words, inputs = self.conditions.conditions, self.conditions.inputs
        for word, name in zip_longest(words, inputs, fillvalue='?'):
            self.stop(_REASONS.get(word, StopReason.UNKNOWN), text=f'input {name}')
        if self.test is not None and _forbids(self.test, now):
            self.stop(StopReason.PERFORMANCE_TEST, text=self.test.text)
        if self.strangers:
            self.stop(StopReason.FOREIGN_PUBLISHER, text=self.strangers)
        if self.zero_step:
            self.stop(StopReason.ZERO_STEP, text=self.zero_step)

    def stop(
        self, reason: StopReason, item_id: int = 0, stamp: int | None = None, text: str = ''
    ) -> None:
        """Request a stop, unless a stop is already requested."""
        self.request = self.request or StopRequest(reason, item_id, stamp, text)

    def advance(self, now: int) -> int:
        """Evaluate the edges and items that are due, and return the number of unassigned edges.

        `now` is a stamp in ns. A stop is requested if no edge belongs to a rejected item, or if an
        edge belongs to an accepted item.
        """
        window = self._window
        near = [self._settle(stamp) for stamp in self._edges if stamp + window < now]
        self._edges = [stamp for stamp in self._edges if stamp + window >= now]
        for item in self._expected:
            if item.reject_at + 2 * window < now and item.rejected and not item.confirmed:
                self.stop(StopReason.UNCONFIRMED_REJECT, item.item_id, item.reject_at)
        self._expected = [item for item in self._expected if item.reject_at + 2 * window >= now]
        return near.count(False)

    def reset(self, now: int) -> None:
        """Clear the stop request, the counters, and the edges and items that are not evaluated yet.

        If a reason persists, a stop is requested again. `now` is the time of the system clock in
        ns.
        """
        self.request = None
        self._in_a_row = self._failed_in_a_row = 0
        self.restart()
        self.check(now)

    @property
    def _window(self) -> int:
        return round(NANOSECONDS * self.parameters.confirmation_time)

    def _settle(self, stamp: int) -> bool:
        """Assign an edge to the item with the nearest reject time.

        Returns whether there is an item whose reject time is within ``confirmation_time`` of the
        edge. If the item was rejected, it is marked as confirmed. If the item was accepted, a stop
        is requested.
        """
        nearest = min(self._expected, key=lambda i: abs(i.reject_at - stamp), default=None)
        if nearest is None or abs(nearest.reject_at - stamp) > self._window:
            return False
        if nearest.rejected:
            nearest.confirmed = True
        else:
            self.stop(StopReason.CONFIRMED_ACCEPT, nearest.item_id, nearest.reject_at)
        return True


def _forbids(test: PerformanceTest, now: int) -> bool:
    """Return whether the performance test stops the line at `now` in ns."""
    if test.state in (PerformanceState.IN_TIME, PerformanceState.DUE):
        return test.stop_at is not None and test.stop_at <= now
    return test.state in (PerformanceState.OVERDUE, PerformanceState.FAILED)


def _counted_on(count: int, again: bool) -> int:
    """Return the number of successive events: `count` + 1 if `again` is true, otherwise 0."""
    return count + 1 if again else 0
