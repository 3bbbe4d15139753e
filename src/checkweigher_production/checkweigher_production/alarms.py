# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Alarms of a line. An alarm is listed until its cause has ended and it has been acknowledged."""

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
    """Return the alarm that the new value of an audit log entry describes.

    Keys of `values` that are not fields of `Alarm` are ignored. Raises TypeError if `values` lacks
    a field without a default value.
    """
    return Alarm(**{e.name: values[e.name] for e in fields(Alarm) if e.name in values})


class AlarmList:
    """Alarms of a line, which are stored as entries of its audit log.

    An entry is written when an alarm begins, recurs, ends or is acknowledged, and for each changed
    alarm when the line is shut down. If an item fault recurs, an entry is written only when its
    count is a power of two. `clock` returns the time in ns. `publish` is called with all alarms at
    the start of the line and after each change.
    """

    def __init__(
        self, trail: AuditTrail, clock: Callable[[], Stamp], publish: Callable[[Alarms], object]
    ) -> None:
        self._trail = trail
        self._clock = clock
        self._publish = publish
        alarms = [alarm_of(each) for each in trail.known(ALARM).values()]
        self._alarms = {(each.source, each.reason): each for each in alarms if not each.over}
        self._nodes: set[str] = set()  # nodes of the line that were started in this run

    def begin_run(self) -> None:
        """Record the start of the line, and add an alarm if its last run was not shut down."""
        if self._trail.last(RUN, 'line') == 'begun':
            self._add(NODE, 'product', _KILLED)
        self._trail.saw(RUN, 'line', None, 'begun')
        self._send()

    def end_run(self) -> None:
        """Record that the line is shut down, with the present counts of its alarms."""
        for alarm in self._alarms.values():
            self._write(alarm)
        self._trail.saw(RUN, 'line', 'begun', 'ended')

    def add_verdict(self, verdict: Verdict) -> None:
        """Add an alarm, or count it again, for each reason of a FAULT verdict.

        A verdict with the reason PerformanceTest is ignored, because its item is a test item.
        """
        if verdict.decision == Decision.FAULT and Reason.PERFORMANCE_TEST not in verdict.reasons:
            for reason in verdict.reasons:
                self._add(FAULT, reason, hint_of(reason))

    def add_started(self, nodes: set[str]) -> None:
        """Add an alarm for each node in `nodes` that was started before in this run.

        `nodes` are the names of the nodes that have just been started. Names that are not in
        `NODES` are ignored.
        """
        for node in nodes.intersection(NODES):
            if node in self._nodes:
                self._add(NODE, node, _RESTARTED)
            self._nodes.add(node)

    def set_stop(self, request: StopRequest | None) -> None:
        """Begin the alarm of a stop request, and end the alarms of all other stop requests.

        If `request` is None, the alarms of all stop requests end. If the reason of `request` is
        NotReady, the alarms of all stop requests end as well, and no alarm begins. The reject node
        also gives this reason when a person stops the line. If the alarm of `request` is already
        active, the alarm is left unchanged.
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
        """Acknowledge all alarms in the name of a person, and return a message for that person."""
        waiting = [each for each in self._alarms.values() if not each.acknowledged_by]
        for alarm in waiting:
            self._put(replace(alarm, acknowledged_by=by.who), write=True, by=by)
        return f'{counted(len(waiting), "alarm")} acknowledged'

    def _add(self, source: str, reason: str, text: str, *, active: bool = False) -> None:
        now = self._clock()
        known = self._alarms.get((source, reason), Alarm(source, reason, text, now, now))
        count = known.count + 1
        # Write an item fault only at the counts 1, 2, 4, 8 and so on, because otherwise a fault of
        # every item would fill the log.
        doubled = count.bit_count() == 1
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
        """Return the diagnostics finding "Alarms", a warning if an alarm is not acknowledged."""
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
