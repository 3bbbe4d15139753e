# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items at each stage: faults, convergence, time taken, verdicts in time."""

from collections import Counter
from collections.abc import Sequence
import math

from checkweigher_core.health.findings import (
    MINUTE,
    Concern,
    Finding,
    Level,
    RecentItems,
    RecentValues,
    conclude,
)
from checkweigher_core.printable import counted
from checkweigher_core.records import NANOSECONDS, MassEstimate, StopRequest, Verdict
from checkweigher_core.records.reasons import Reason

_TOO_MANY_FAILED = 0.05  # share of the last items
_FEWEST_FAILED = 2
_ALL_FAIL = 5  # in a row
_BUSY = 0.5  # share of the time
_BUSY_SPAN = 10.0  # s
_NOT_CONVERGED = (Reason.NO_CONVERGENCE, Reason.SPEED_NOT_TRAINED, Reason.NO_LOAD)
_RECENT = 10  # items
_USUAL = 300
_FEWEST_USUAL = 30
_FREQUENCY_CHANGE = 0.2  # relative; a product of a tenth of the platform lowers it by 5 %
_SWINGS = 0.5  # damping ratio
_UNCERTAIN = 0.5  # share of max_relative_std_dev
_MAX_EDGES = 200
_NO_MASSES = 3  # items in a row


def reason_hint(reason: str) -> str:
    """Return what to look at for a reason, also for one that is not in `Reason`."""
    return Reason(reason).hint if reason in list(Reason) else 'see docs/reasons.md'


def failures(items: RecentItems, what: str) -> list[Concern]:
    """Return the concerns of items that fail lately: WARN if many, ERROR if all."""
    reason = items.main_reason
    if items.failed_in_a_row >= _ALL_FAIL:
        text = f'the last {items.failed_in_a_row} items {what}, mostly {reason}'
        return [Concern(Level.ERROR, text, reason_hint(reason))]
    if items.failed >= max(_FEWEST_FAILED, _TOO_MANY_FAILED * len(items)):
        text = f'{items.failed} of the last {len(items)} items {what}, mostly {reason}'
        return [Concern(Level.WARN, text, reason_hint(reason))]
    return []


class FaultWatch:
    """Count what the segmenter could not cut, by reason."""

    def __init__(self) -> None:
        self._items = RecentItems()
        self._count = 0
        self._reasons: Counter[str] = Counter()

    def add(self, now: float, reasons: Sequence[str]) -> None:
        """Take an item and its reasons."""
        self._count += 1
        self._items.add(now, reasons)
        self._reasons.update(reasons)

    def finding(self, now: float) -> Finding:
        """Return the aspect Items."""
        self._items.forget(now)
        values: dict[str, float | str] = {
            'items': self._count,
            'lately': len(self._items),
            'faults_lately': self._items.failed,
            **self._reasons,
        }
        faults, items = counted(self._items.failed, 'fault'), counted(len(self._items), 'item')
        well = f'{faults} in the last {items}'
        return conclude('Items', well, failures(self._items, 'were faults'), values)


class WorkloadWatch:
    """Follow how long a stage works on each window."""

    def __init__(self) -> None:
        self._taken = RecentValues(_BUSY_SPAN)
        self._count = 0
        self._last: float | None = None

    def add(self, now: float, taken: float) -> None:
        """Note that the work on a window, done at `now`, took so long; both in s."""
        self._count += 1
        self._last = now
        self._taken.add(now, taken)

    def finding(self, now: float) -> Finding:
        """Return the aspect Windows."""
        self._taken.forget(now)
        share = self._taken.total / _BUSY_SPAN
        values = {
            'windows': self._count,
            'age_of_last_window_s': math.nan if self._last is None else now - self._last,
            'time_taken_median_ms': 1e3 * self._taken.median,
            'time_taken_max_ms': 1e3 * self._taken.largest,
            'busy_share': share,
        }
        found = []
        if share > _BUSY:
            text = f'busy for {100 * share:.0f} % of the time'
            hint = 'check the load on this machine; a faster estimator or machine is needed'
            found.append(Concern(Level.WARN, text, hint))
        well = f'busy for {100 * share:.1f} % of the time' if self._count else 'no window yet'
        return conclude('Windows', well, found, values)


class ConvergenceWatch:
    """Follow how sure the estimates are, and whether the platform is the one it was."""

    def __init__(self) -> None:
        self._items = RecentItems()
        self._relative = RecentValues(10 * MINUTE, _RECENT)
        self._frequency = RecentValues(10 * MINUTE, _RECENT)
        self._damping = RecentValues(10 * MINUTE, _RECENT)
        self._usual = RecentValues(60 * MINUTE, _USUAL)

    def add(self, now: float, estimate: MassEstimate) -> None:
        """Take an estimate of a window that the segmenter could cut."""
        self._items.add(now, [reason for reason in estimate.reasons if reason in _NOT_CONVERGED])
        if estimate.weighed and estimate.mass > 0:
            self._relative.add(now, estimate.std_dev / estimate.mass)
            # Where nothing of the swinging is left in the signal, its frequency means nothing.
            if estimate.damping_ratio < _SWINGS:
                self._frequency.add(now, estimate.natural_frequency)
                self._damping.add(now, estimate.damping_ratio)
                self._usual.add(now, estimate.natural_frequency)

    def finding(self, now: float, max_relative_std_dev: float) -> Finding:
        """Return the aspect Convergence; beyond `max_relative_std_dev` it is NoConvergence."""
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
        found = failures(self._items, 'were not identified')
        if relative > _UNCERTAIN * max_relative_std_dev:
            text = f'masses are uncertain by {100 * relative:.1f} %'
            hint = 'check Belt noise of segmenter, and run tune on passes of this machine'
            found.append(Concern(Level.WARN, text, hint))
        if abs(frequency - usual) > _FREQUENCY_CHANGE * usual:
            text = f'the platform swings at {frequency:.1f} Hz, usually at {usual:.1f} Hz'
            hint = 'check its fastening, and for something that lies on it or touches it'
            found.append(Concern(Level.WARN, text, hint))
        well = 'no item yet'
        if not math.isnan(relative):
            well = f'masses are certain to {100 * relative:.2f} %'
        return conclude('Convergence', well, found, values)


class VerdictWatch:
    """Follow how soon after the outfeed edge a verdict is there, and how long before its time."""

    def __init__(self) -> None:
        self._edges: dict[int, float] = {}  # arrival of outfeed edges by stamp
        self._latency = RecentValues()
        self._margin = RecentValues()
        self._late = RecentValues()
        self._masses = RecentItems()
        self._counts: Counter[str] = Counter()

    def add_edge(self, now: float, stamp: int) -> None:
        """Take the arrival of an outfeed edge at `now`, s."""
        self._edges[stamp] = now
        if len(self._edges) > _MAX_EDGES:
            del self._edges[next(iter(self._edges))]

    def add(self, now: float, verdict: Verdict) -> None:
        """Take a verdict that was published at `now`, s."""
        self._counts.update((verdict.decision.name, *verdict.reasons))
        missing = () if verdict.estimate_id else (Reason.NO_ESTIMATE.value,)
        self._masses.add(now, missing)
        if verdict.late:
            self._late.add(now, 1.0)
        came = None if verdict.t3 is None else self._edges.pop(verdict.t3, None)
        if came is None or verdict.t3 is None:
            return
        self._latency.add(now, now - came)
        if verdict.reject_at is not None:
            left = (verdict.reject_at - verdict.t3) / NANOSECONDS - (now - came)
            if not missing:  # such a one comes at the last moment
                self._margin.add(now, left)

    def verdicts(self, now: float, verdict_margin: float, *, deadlines: bool) -> Finding:
        """Return the aspect Verdicts; the parameters are those of the reject stage."""
        for recent in (self._latency, self._margin, self._late):
            recent.forget(now)
        values: dict[str, float | str] = {
            'latency_median_ms': 1e3 * self._latency.median,
            'latency_max_ms': 1e3 * self._latency.largest,
            'least_margin_ms': 1e3 * self._margin.smallest,
            'late_lately': len(self._late),
            **self._counts,
        }
        found = []
        if deadlines and len(self._late):
            late = counted(len(self._late), 'verdict')
            text = f'{late} came after the reject time in the last minute'
            hint = 'check the load on this machine, rejector_distance and actuator_delay'
            found.append(Concern(Level.ERROR, text, hint))
        elif deadlines and self._margin.smallest < verdict_margin:
            text = f'a verdict came only {1e3 * self._margin.smallest:.0f} ms before its time'
            hint = 'check the load on this machine; a rejector further away leaves more time'
            found.append(Concern(Level.WARN, text, hint))
        well = 'no verdict in the last minute'
        if len(self._latency):
            well = f'{1e3 * self._latency.median:.1f} ms after the outfeed edge'
        return conclude('Verdicts', well, found, values)

    def line(self, now: float, missing: str) -> Finding:
        """Return the aspect Line; `missing` is the stage that is not there, empty if all are."""
        self._masses.forget(now)
        failed, in_a_row = self._masses.failed, self._masses.failed_in_a_row
        values = {'items_lately': len(self._masses), 'without_mass_lately': failed}
        hint = 'check the other nodes and the load on this machine'
        if missing:
            hint = f'{missing} is not there: start it'
        found = []
        if in_a_row >= _NO_MASSES:
            text = f'no mass came of the last {in_a_row} items that the eyes saw'
            found.append(Concern(Level.ERROR, text, hint))
        elif missing:
            found.append(Concern(Level.ERROR, 'no masses can come', hint))
        elif failed:
            text = f'no mass came of {failed} of the last {len(self._masses)} items'
            found.append(Concern(Level.WARN, text, hint))
        return conclude('Line', 'a mass comes of every item', found, values)


class RejectorWatch:
    """Follow whether the rejector does what it is told."""

    def __init__(self) -> None:
        self._strays = RecentValues()
        self._count = 0

    def add_strays(self, now: float, count: int) -> None:
        """Take how many edges of the eye behind the rejector were near no reject time."""
        if count:
            self._strays.add(now, count)
            self._count += count

    def finding(self, now: float, request: StopRequest | None, *, confirmed: bool) -> Finding:
        """Return the aspect Rejector; `confirmed`: there is an eye behind the rejector."""
        self._strays.forget(now)
        values: dict[str, float | str] = {
            'reject_eye_strays': self._count,
            'stop_request': request.reason.value if request else 'none',
        }
        found = []
        if request is not None:
            text = f'stop requested: {request.reason}'
            if request.item_id:
                text += f' at item {request.item_id}'
            hint = f'{request.hint}; then call reset_stop_request'
            found.append(Concern(Level.ERROR, text, hint))
        if len(self._strays):
            text = f'reject_eye saw {self._strays.total:.0f} things near no reject time'
            hint = 'check rejector_distance, actuator_delay and confirmation_time'
            found.append(Concern(Level.WARN, text, hint))
        well = 'rejects are confirmed' if confirmed else 'no eye confirms rejects'
        return conclude('Rejector', well, found, values)
