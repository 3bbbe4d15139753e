# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Monitoring of the rejector against the verdicts, and requests to stop the line."""

from dataclasses import dataclass

from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    EyeEdge,
    MachineConditions,
    PerformanceState,
    PerformanceTest,
    StopRequest,
    Verdict,
)
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_dsp.rejection.inspections import Missed
from checkweigher_dsp.rejection.parameters import RejectParameters

_MAX_OPEN = 10_000
_CONDITIONS = {
    reason.value: reason
    for reason in (
        StopReason.GUARD_OPEN, StopReason.AIR_PRESSURE, StopReason.BIN_FULL,
        StopReason.INSPECTION_FAULT,
    )
}  # fmt: skip


@dataclass(slots=True, eq=False)
class _Expected:
    """A verdict whose item is near the rejector at ``reject_at``, ns."""

    item_id: int
    reject_at: int
    rejected: bool
    confirmed: bool = False


class RejectMonitor:
    """Compare the verdicts with what the eye behind the rejector sees.

    An edge of that eye belongs to the item whose reject time is nearest, within
    ``confirmation_time``. It is looked at as soon as no nearer item can come any more. The
    parameters may be replaced at any time.
    """

    def __init__(self, parameters: RejectParameters) -> None:
        self.parameters = parameters
        self.request: StopRequest | None = None  # the first reason to stop since the last reset
        self.strays = 0  # edges near no reject time
        # What the driver says is wrong; while it lasts a reset does not clear the request.
        self.trouble = ''
        self.conditions = MachineConditions(0, True)  # by the inputs of the machine
        self.test: PerformanceTest | None = None
        self.strangers = ''  # who publishes topics of the line beside their makers
        self._in_a_row = 0
        self._expected: list[_Expected] = []
        self._edges: list[int] = []

    @property
    def due(self) -> int | None:
        """Stamp from which on something can be concluded, ns, None if nothing is waited for."""
        window = self._window
        times = [stamp + window for stamp in self._edges]
        times += [item.reject_at + 2 * window for item in self._expected]
        return min(times) + 1 if times else None

    def add_verdict(self, verdict: Verdict) -> None:
        """Take a verdict."""
        rejected = verdict.decision is not Decision.ACCEPT
        if Reason.PERFORMANCE_TEST not in verdict.reasons:
            self._in_a_row = self._in_a_row + 1 if rejected else 0
        limit = self.parameters.max_rejects_in_a_row
        if limit and self._in_a_row >= limit:
            self._stop(StopReason.TOO_MANY_REJECTS, verdict.item_id, verdict.reject_at)
        # What a station takes off does not come to the eye behind the rejector.
        if self._window and verdict.reject_at is not None and not (rejected and verdict.station):
            self._expected.append(_Expected(verdict.item_id, verdict.reject_at, rejected))
            del self._expected[:-_MAX_OPEN]

    def add_edge(self, edge: EyeEdge) -> None:
        """Take an edge of the eye behind the rejector."""
        if self._window and edge.blocked:
            self._edges.append(edge.stamp)
            del self._edges[:-_MAX_OPEN]

    def hear_driver(self, trouble: str) -> None:
        """Take what the driver says is wrong with the machine, empty for nothing."""
        self.trouble = trouble
        if not trouble:
            return
        if self.request is not None and self.request.reason is StopReason.DRIVER_TROUBLE:
            self.request = None  # what is wrong by now, such as a product that was missed meanwhile
        self._stop(StopReason.DRIVER_TROUBLE, 0, None, trouble)

    def hear_conditions(self, conditions: MachineConditions) -> None:
        """Take what is wrong by the inputs of the machine."""
        self.conditions = conditions
        if not conditions.known:
            self._stop(StopReason.DRIVER_TROUBLE, 0, None, 'the machine inputs are not read')
        for word, name in zip(conditions.conditions, conditions.inputs, strict=False):
            self._stop(_CONDITIONS.get(word, StopReason.UNKNOWN), 0, None, f'input {name}')

    def hear_test(self, test: PerformanceTest | None, now: int) -> None:
        """Take the performance test, at `now`, ns of the system clock: its grace may be over."""
        self.test = test
        if test is None:
            return
        waits = test.state in (PerformanceState.IN_TIME, PerformanceState.DUE)
        over = waits and test.stop_at is not None and test.stop_at <= now
        if over or test.state in (PerformanceState.OVERDUE, PerformanceState.FAILED):
            self._stop(StopReason.PERFORMANCE_TEST, 0, None, test.text)

    def hear_strangers(self, strangers: str) -> None:
        """Update who publishes topics of the line beside their makers, empty for nobody."""
        self.strangers = strangers
        if strangers:
            self._stop(StopReason.FOREIGN_PUBLISHER, 0, None, strangers)

    def miss(self, missed: Missed) -> None:
        """Take a reject of an inspection device that no verdict could heed."""
        reason = StopReason.MISSED_EXTERNAL_REJECT
        self._stop(reason, missed.item_id, missed.stamp, missed.text)

    def miss_items(self) -> None:
        """Ask for a stop: items leave the belt that the segmenter does not announce."""
        self._stop(StopReason.NO_ITEMS, 0, None)

    def advance(self, now: int) -> None:
        """Conclude what can be concluded at `now`, ns of the stamps."""
        window = self._window
        for stamp in self._edges:
            if stamp + window < now:
                self._settle(stamp, window)
        self._edges = [stamp for stamp in self._edges if stamp + window >= now]
        for item in self._expected:
            over = item.reject_at + 2 * window < now
            if over and item.rejected and not item.confirmed:
                self._stop(StopReason.UNCONFIRMED_REJECT, item.item_id, item.reject_at)
        self._expected = [item for item in self._expected if item.reject_at + 2 * window >= now]

    def restart(self) -> None:
        """Expect nothing any more: the stamps of a new stream say nothing about the old one."""
        self._expected, self._edges = [], []

    def reset(self, now: int = 0) -> None:
        """Clear the request at `now`, ns of the system clock, unless what is wrong lasts.

        What was rejected before it does not count any more.
        """
        self.request = None
        self._in_a_row = 0
        self.restart()
        self.hear_driver(self.trouble)
        self.hear_conditions(self.conditions)
        self.hear_test(self.test, now)
        self.hear_strangers(self.strangers)

    @property
    def _window(self) -> int:
        return round(NANOSECONDS * self.parameters.confirmation_time)

    def _settle(self, stamp: int, window: int) -> None:
        nearest = min(self._expected, key=lambda i: abs(i.reject_at - stamp), default=None)
        if nearest is None or abs(nearest.reject_at - stamp) > window:
            self.strays += 1
        elif nearest.rejected:
            nearest.confirmed = True
        else:
            self._stop(StopReason.CONFIRMED_ACCEPT, nearest.item_id, nearest.reject_at)

    def _stop(self, reason: StopReason, item_id: int, stamp: int | None, text: str = '') -> None:
        self.request = self.request or StopRequest(reason, item_id, stamp, text)
