# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The alarms of a lane: what went wrong, until it is over and a person has acknowledged it."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, replace
from typing import Any

from checkweigher_core.changes import ALARM, RUN
from checkweigher_core.health.findings import Finding, conclude, warn_if
from checkweigher_core.printable import counted
from checkweigher_core.records import (
    NANOSECONDS,
    Alarm,
    Alarms,
    Decision,
    Stamp,
    StopRequest,
    Verdict,
    utc,
)
from checkweigher_core.records.reasons import Reason, StopReason, hint_of
from checkweigher_core.ros.ports import NODES
from checkweigher_production.audit_trail import AuditTrail, Author

STOP, FAULT, NODE = 'stop', 'fault', 'node'
_RESTARTED = 'it was started again while the line ran; look into its log'
_KILLED = 'it ended without being stopped: it was killed, it hung, or power was lost'


def alarm_of(values: Mapping[str, Any]) -> Alarm:
    """Return the alarm of an entry of the audit log; fields of newer versions are dropped."""
    return Alarm(**{e.name: values[e.name] for e in fields(Alarm) if e.name in values})


class AlarmList:
    """The alarms of a lane, which are entries of its audit log and are restored from them.

    An entry is written when an alarm comes, ends or is acknowledged, and when the line is stopped;
    of a fault only when it has come twice as often as its last entry says. `clock` returns the time
    in ns.
    """

    def __init__(
        self, trail: AuditTrail, clock: Callable[[], Stamp], publish: Callable[[Alarms], object]
    ) -> None:
        self._trail = trail
        self._clock = clock
        self._publish = publish
        alarms = [alarm_of(each) for each in trail.known(ALARM).values()]
        self._alarms = {(each.source, each.reason): each for each in alarms if not each.over}
        self._nodes: set[str] = set()  # nodes that have been started

    def begin_run(self) -> None:
        """Record that the line runs; it is an alarm if the run before did not end in order."""
        if self._trail.last(RUN, 'line') == 'begun':
            self._add(NODE, 'product', _KILLED)
        self._trail.saw(RUN, 'line', None, 'begun')
        self._send()

    def end_run(self) -> None:
        """Record that the line ends in order, and the present counts of its alarms."""
        for alarm in self._alarms.values():
            self._write(alarm)
        self._trail.saw(RUN, 'line', 'begun', 'ended')

    def add_verdict(self, verdict: Verdict) -> None:
        """Count the reasons of a fault; faults during a performance test are none."""
        if verdict.decision == Decision.FAULT and Reason.PERFORMANCE_TEST not in verdict.reasons:
            for reason in verdict.reasons:
                self._add(FAULT, reason, hint_of(reason))

    def add_started(self, nodes: set[str]) -> None:
        """Count the nodes that are started for a second time."""
        for node in nodes.intersection(NODES):
            if node in self._nodes:
                self._add(NODE, node, _RESTARTED)
            self._nodes.add(node)

    def set_stop(self, request: StopRequest | None) -> None:
        """Begin the alarm of a stop request, and end those of other requests; None ends all.

        NotReady is no alarm: it comes whenever a person stops the line.
        """
        if request is not None and request.reason is StopReason.NOT_READY:
            request = None
        for alarm in tuple(self._alarms.values()):
            if alarm.active and (request is None or alarm.reason != request.reason):
                now = self._clock()
                lasted = alarm.duration + max(now - alarm.last, 0) / NANOSECONDS
                self._put(replace(alarm, last=now, active=False, duration=lasted), write=True)
        if request is not None:
            known = self._alarms.get((STOP, request.reason.value))
            if known is None or not known.active:
                self._add(STOP, request.reason.value, request.hint, active=True)

    def acknowledge(self, by: Author) -> str:
        """Acknowledge all alarms for a person, and return what was done in words."""
        waiting = [each for each in self._alarms.values() if not each.acknowledged_by]
        for alarm in waiting:
            self._put(replace(alarm, acknowledged_by=by.who), write=True, by=by)
        return f'{counted(len(waiting), "alarm")} acknowledged'

    def _add(self, source: str, reason: str, text: str, *, active: bool = False) -> None:
        now = self._clock()
        known = self._alarms.get((source, reason), Alarm(source, reason, text, now, now))
        count = known.count + 1
        doubled = count.bit_count() == 1  # a fault with each item must not fill the log
        added = replace(known, text=text, last=now, count=count, active=active)
        self._put(added, write=source != FAULT or doubled)

    def _put(self, alarm: Alarm, *, write: bool, by: Author | None = None) -> None:
        key = alarm.source, alarm.reason
        self._alarms[key] = alarm
        if write:
            self._write(alarm, by)
        if alarm.over:
            del self._alarms[key]
        self._send()

    def _write(self, alarm: Alarm, by: Author | None = None) -> None:
        self._trail.saw_state(ALARM, f'{alarm.source} {alarm.reason}', asdict(alarm), by)

    def _send(self) -> None:
        self._publish(Alarms(self._clock(), tuple(self._alarms.values())))

    def finding(self) -> Finding:
        """Return the aspect Alarms of the diagnostics."""
        waiting = [
            f'{each.source} {each.reason}'
            for each in self._alarms.values()
            if not each.acknowledged_by
        ]
        text = f'not acknowledged: {", ".join(waiting)}'
        hint = 'find the cause of each, then acknowledge them'
        concerns = (warn_if(bool(waiting), text, hint),)
        values = {f'{a.source} {a.reason}': _in_words(a) for a in self._alarms.values()}
        return conclude('Alarms', 'none to acknowledge', concerns, values)


def _in_words(alarm: Alarm) -> str:
    times = counted(alarm.count, 'time')
    return f'{times} from {utc(alarm.first)} to {utc(alarm.last)}'
