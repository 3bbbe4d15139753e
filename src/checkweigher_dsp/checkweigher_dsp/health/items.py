# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Findings on the items at each stage: faults, convergence, computing time and verdicts."""

from collections import Counter
from collections.abc import Sequence
import math

from checkweigher_core.health.findings import (
    MINUTE,
    Concern,
    Finding,
    RecentItems,
    RecentValues,
    Values,
    conclude,
    error_if,
    warn_if,
)
from checkweigher_core.printable import counted
from checkweigher_core.records import NANOSECONDS, Decision, MassEstimate, StopRequest, Verdict
from checkweigher_core.records.reasons import Reason

_TOO_MANY_FAILED = 0.05  # minimum fraction of failed items for a warning
_FEWEST_FAILED = 2  # minimum number of failed items for a warning
_ALL_FAIL = 5  # number of successive failed items for an error
_BUSY = 0.5  # fraction of the time spent on computing, above which a warning is given
_BUSY_SPAN = 10.0  # period in s over which the computing time is summed
_NOT_CONVERGED = (Reason.NO_CONVERGENCE, Reason.SPEED_NOT_TRAINED, Reason.NO_LOAD)
# Maximum number of items in the current medians.
_RECENT = 10
# Maximum number of items whose median is the usual natural frequency.
_USUAL = 300
# Minimum number of items from which the usual natural frequency is computed.
_FEWEST_USUAL = 30
# Relative change of the natural frequency above which a warning is given. A product whose mass is a
# tenth of the moving mass of the platform lowers the frequency by 5 %.
_FREQUENCY_CHANGE = 0.2
_SWINGS = 0.5  # damping ratio from which the natural frequency is too uncertain to be used
_UNCERTAIN = 0.5  # fraction of max_relative_std_dev above which a warning is given
_MAX_EDGES = 200  # maximum number of stored outfeed edges
_ALIKE = 10  # number of successive items with the decision UNDER, or OVER, for a warning
_NO_MASSES = 3  # number of successive items without a mass for an error


def failures(items: RecentItems, what: str) -> list[Concern | None]:
    """Return an error if the last five items failed, and a warning if many recent items failed.

    The warning requires at least two failed items and at least 5 % of the recent items. In the
    result, an error or a warning that does not apply is None. `what` is the predicate
    of the messages, such as 'were faults'.
    """
    in_a_row, failed = items.failed_in_a_row, items.failed
    reason = items.main_reason(in_a_row if in_a_row >= _ALL_FAIL else len(items))
    hint = Reason(reason).hint if reason in list(Reason) else 'see docs/reasons.md'
    return [
        error_if(in_a_row >= _ALL_FAIL, f'the last {in_a_row} items {what}, mostly {reason}', hint),
        warn_if(
            failed >= max(_FEWEST_FAILED, _TOO_MANY_FAILED * len(items)),
            f'{failed} of the last {len(items)} items {what}, mostly {reason}',
            hint,
        ),
    ]


class FaultWatch:
    """Statistics of the items at the segmenter, with the number of faults of each reason."""

    def __init__(self) -> None:
        self._items = RecentItems()
        self._count = 0
        self._reasons: Counter[str] = Counter()

    def add(self, now: float, reasons: Sequence[str]) -> None:
        """Add an item at `now` in s. `reasons` is empty if the item is not a fault."""
        self._count += 1
        self._items.add(now, reasons)
        self._reasons.update(reasons)

    def finding(self, now: float) -> Finding:
        """Return the finding on recent faults (aspect Items)."""
        self._items.forget(now)
        values: Values = {
            'items': self._count,
            'lately': len(self._items),
            'faults_lately': self._items.failed,
            **self._reasons,
        }
        faults, items = counted(self._items.failed, 'fault'), counted(len(self._items), 'item')
        well = f'{faults} in the last {items}'
        return conclude('Items', well, failures(self._items, 'were faults'), values)


class WorkloadWatch:
    """Statistics of the computing time of a stage per window."""

    def __init__(self) -> None:
        self._taken = RecentValues(_BUSY_SPAN)
        self._count = 0
        self._last = math.nan

    def add(self, began: float, ended: float) -> None:
        """Add a window that was processed from `began` to `ended`, both in s."""
        self._count += 1
        self._last = ended
        self._taken.add(ended, ended - began)

    def finding(self, now: float) -> Finding:
        """Return the finding on the computing time (aspect Windows)."""
        self._taken.forget(now)
        share = self._taken.total / _BUSY_SPAN
        values = {
            'windows': self._count,
            'age_of_last_window_s': now - self._last,
            'time_taken_median_ms': 1e3 * self._taken.median,
            'time_taken_max_ms': 1e3 * self._taken.largest,
            'busy_share': share,
        }
        busy = warn_if(
            share > _BUSY,
            f'busy for {100 * share:.0f} % of the time',
            'check the load on this machine; a faster estimator or machine is needed',
        )
        well = f'busy for {100 * share:.1f} % of the time' if self._count else 'no window yet'
        return conclude('Windows', well, [busy], values)


class ConvergenceWatch:
    """Statistics of the uncertainty of the masses and of the natural frequency of the platform."""

    def __init__(self) -> None:
        self._items = RecentItems()
        self._relative = RecentValues(10 * MINUTE, _RECENT)
        self._frequency = RecentValues(10 * MINUTE, _RECENT)
        self._damping = RecentValues(10 * MINUTE, _RECENT)
        self._usual = RecentValues(60 * MINUTE, _USUAL)

    def add(self, now: float, estimate: MassEstimate) -> None:
        """Add the estimate of a window that is not a fault; `now` is the time in s."""
        self._items.add(now, [reason for reason in estimate.reasons if reason in _NOT_CONVERGED])
        if estimate.weighed and estimate.mass > 0:
            self._relative.add(now, estimate.std_dev / estimate.mass)
            # The frequency is uncertain if the platform hardly oscillates. If the estimator does
            # not identify the platform, the damping ratio is NaN, and the comparison is False.
            if estimate.damping_ratio < _SWINGS:
                self._frequency.add(now, estimate.natural_frequency)
                self._damping.add(now, estimate.damping_ratio)
                self._usual.add(now, estimate.natural_frequency)

    def finding(self, now: float, max_relative_std_dev: float) -> Finding:
        """Return the finding on the uncertainty of the masses (aspect Convergence).

        `max_relative_std_dev` is a parameter of the identifier. A warning is given if the median
        relative standard deviation of the masses exceeds half of `max_relative_std_dev`.
        """
        for recent in (self._items, self._relative, self._frequency, self._damping, self._usual):
            recent.forget(now)
        relative, frequency = self._relative.median, self._frequency.median
        usual = self._usual.median if len(self._usual) >= _FEWEST_USUAL else math.nan
        values = {
            'items_lately': len(self._items),
            'failed_lately': self._items.failed,
            'relative_std_dev_percent': 100 * relative,
            'natural_frequency_hz': frequency,
            'usual_natural_frequency_hz': usual,
            'damping_ratio': self._damping.median,
        }
        concerns = [
            *failures(self._items, 'were not identified'),
            warn_if(
                relative > _UNCERTAIN * max_relative_std_dev,
                f'the masses have a relative standard deviation of {100 * relative:.1f} %',
                'check Belt noise of segmenter, and run tune on passes of this machine',
            ),
            warn_if(
                abs(frequency - usual) > _FREQUENCY_CHANGE * usual,
                f'the platform oscillates at {frequency:.1f} Hz, usually at {usual:.1f} Hz',
                'check its fastening, and whether an object lies on it or touches it',
            ),
        ]
        certain = f'relative standard deviation {100 * relative:.2f} %'
        return conclude(
            'Convergence', 'no item yet' if math.isnan(relative) else certain, concerns, values
        )


class VerdictTiming:
    """Statistics of the latency of the verdicts and of the margin before their reject times."""

    def __init__(self) -> None:
        self._edges: dict[int, float] = {}  # arrival times of outfeed edges in s, by stamp
        self._latency = RecentValues()
        self._margin = RecentValues()
        self._late = RecentValues()
        self._masses = RecentItems()
        self._counts: Counter[str] = Counter()
        # Decision of the latest verdict, and number of latest verdicts in a row with this decision.
        self._row = Decision.ACCEPT, 0

    def add_edge(self, now: float, stamp: int) -> None:
        """Add an outfeed edge that arrived at `now` in s; its stamp is in ns."""
        self._edges[stamp] = now
        if len(self._edges) > _MAX_EDGES:
            del self._edges[next(iter(self._edges))]

    def add(self, now: float, verdict: Verdict) -> None:
        """Add a verdict that was published at `now` in s."""
        self._counts.update((verdict.decision.name, *verdict.reasons))
        decision, count = self._row
        self._row = verdict.decision, count + 1 if verdict.decision == decision else 1
        missing = () if verdict.estimate_id else (Reason.NO_ESTIMATE.value,)
        self._masses.add(now, missing)
        if verdict.late:
            self._late.add(now, 1.0)
        came = None if verdict.t3 is None else self._edges.pop(verdict.t3, None)
        if came is None or verdict.t3 is None:
            return
        self._latency.add(now, now - came)
        # Omit the margin of a verdict without a mass, which always waits for its deadline.
        if verdict.reject_at is not None and not missing:
            self._margin.add(now, (verdict.reject_at - verdict.t3) / NANOSECONDS - (now - came))

    def verdicts(self, now: float, verdict_margin: float, *, deadlines: bool) -> Finding:
        """Return the finding on the timing of the verdicts (aspect Verdicts).

        `verdict_margin`, in s, and `deadlines` are parameters of the reject stage. Without
        `deadlines`, late verdicts and small margins cause no error or warning.
        """
        for recent in (self._latency, self._margin, self._late):
            recent.forget(now)
        latency, margin = 1e3 * self._latency.median, self._margin.smallest
        decision, count = self._row
        values: Values = {
            'latency_median_ms': latency,
            'latency_max_ms': 1e3 * self._latency.largest,
            'least_margin_ms': 1e3 * margin,
            'late_lately': len(self._late),
            **self._counts,
        }
        concerns = [
            error_if(
                deadlines and len(self._late) > 0,
                f'{counted(len(self._late), "verdict")} came after the reject time in the last '
                'minute',
                'check the load on this machine, rejector_distance and actuator_delay',
            ),
            warn_if(
                deadlines and margin < verdict_margin,
                f'a verdict came only {1e3 * margin:.0f} ms before its reject time',
                'check the load on this machine; a more distant rejector leaves more time',
            ),
            warn_if(
                count >= _ALIKE and decision in (Decision.UNDER, Decision.OVER),
                f'the last {count} items were {decision.name}',
                'see whether the product on the belt is the selected one, and check its limits',
            ),
        ]
        has_come = f'{latency:.1f} ms after the outfeed edge'
        well = has_come if len(self._latency) else 'no verdict in the last minute'
        return conclude('Verdicts', well, concerns, values)

    def line(self, now: float, missing: str) -> Finding:
        """Return the finding on missing masses (aspect Line).

        `missing` is the name of the stage without which no mass can arrive, or empty if it runs.
        """
        self._masses.forget(now)
        failed, in_a_row = self._masses.failed, self._masses.failed_in_a_row
        values = {'items_lately': len(self._masses), 'without_mass_lately': failed}
        other = 'check the other nodes and the load on this machine'
        hint = f'{missing} does not run: start it' if missing else other
        concerns = [
            error_if(
                in_a_row >= _NO_MASSES,
                f'no mass of the last {in_a_row} items has arrived',
                hint,
            ),
            error_if(bool(missing), 'no mass can arrive', hint),
            warn_if(
                failed > 0, f'{failed} of the last {len(self._masses)} items have no mass', hint
            ),
        ]
        return conclude('Line', 'the mass of each item has arrived', concerns, values)


class RejectorWatch:
    """Statistics of the eye behind the rejector, which confirms rejects."""

    def __init__(self) -> None:
        self._strays = RecentValues()
        self._count = 0

    def add_strays(self, now: float, count: int) -> None:
        """Add `count` edges of the eye behind the rejector that belong to no item."""
        if count:
            self._strays.add(now, count)
            self._count += count

    def finding(self, now: float, request: StopRequest | None, *, confirmed: bool) -> Finding:
        """Return the finding on the rejector and the stop request (aspect Rejector).

        `request` is the current stop request, or None if no stop is requested. `confirmed` is
        true if an eye behind the rejector confirms rejects.
        """
        self._strays.forget(now)
        values: Values = {
            'reject_eye_strays': self._count,
            'stop_request': request.reason.value if request else 'none',
        }
        concerns = [
            warn_if(
                len(self._strays) > 0,
                f'reject_eye saw {self._strays.total:.0f} objects that match no reject time',
                'check rejector_distance, actuator_delay and confirmation_time',
            )
        ]
        if request is not None:
            place = f'{request.reason} at item {request.item_id}'
            why = place if request.item_id else request.reason
            hint = f'{request.hint}; then reset the stop'
            concerns.append(error_if(True, f'stop requested: {why}', hint))
        well = 'rejects are confirmed' if confirmed else 'no eye confirms rejects'
        return conclude('Rejector', well, concerns, values)
