# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The latest diagnostics of running lines, worst first, including silent nodes."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
import threading
from typing import Any

from checkweigher_core.health.findings import Level
from checkweigher_core.printable import counted, one_line
from checkweigher_core.records import Decision
from checkweigher_core.ros.ports import NODES, STAGES

HOST = 'host'  # key in a node's own status for the name of its computer
_SILENCE = 3.0  # s, three periods of the diagnostics
_URGENCY = (Level.OK, Level.WARN, Level.STALE, Level.ERROR)  # rising


@dataclass(frozen=True, slots=True)
class Row:
    """One aspect of one node, as last reported."""

    node: str
    aspect: str
    level: Level
    message: str
    values: tuple[tuple[str, str], ...] = ()
    silence: float = 0.0  # s since the last report, 0 unless it is overdue


class StatusBoard:
    """Latest report of each node of the lane `namespace`, or of all lanes if that is empty."""

    def __init__(self, namespace: str = '') -> None:
        self._namespace = namespace
        self._nodes: dict[str, tuple[float, list[Row]]] = {}
        self._expected: dict[str, float] = {}  # lanes, and since when
        self._lock = threading.Lock()

    def add(self, now: float, statuses: Iterable[Any]) -> None:
        """Add the statuses of one DiagnosticArray, which arrived at `now`, s."""
        reported: dict[str, list[Row]] = {}
        for status in statuses:
            node, _, aspect = one_line(status.name).partition(': ')
            lane, _, name = node.strip('/').rpartition('/')
            if name in NODES and self._namespace in ('', lane):
                values = tuple((one_line(v.key), one_line(v.value)) for v in status.values)
                level = Level(min(status.level[0], Level.STALE))
                reported.setdefault(node, []).append(
                    Row(node, aspect, level, one_line(status.message), values)
                )
        with self._lock:
            for node, rows in reported.items():
                self._nodes[node] = now, rows

    def expect(self, now: float, lane: str) -> None:
        """Count the nodes of a lane as silent from `now`, s, until one of them reports."""
        with self._lock:
            self._expected[lane] = now

    def hosts(self) -> dict[str, set[str]]:
        """Return the host names in the latest reports of each lane."""
        found: dict[str, set[str]] = {}
        with self._lock:
            for node, (_, rows) in self._nodes.items():
                found.setdefault(node.rpartition('/')[0], set()).update(
                    value for row in rows for key, value in row.values if key == HOST
                )
        return found

    @property
    def heard(self) -> bool:
        """Whether any node has reported."""
        return bool(self._nodes)

    def rows(self, now: float) -> list[Row]:
        """Return all rows at `now`, s, the worst first; silent and missing nodes are STALE."""
        with self._lock:
            nodes, expected = dict(self._nodes), dict(self._expected)
        found = []
        for node, (heard, rows) in nodes.items():
            if now - heard > _SILENCE:
                text = f'silent for {now - heard:.0f} s; its process hangs or has ended, start it'
                found.append(Row(node, '', Level.STALE, text, silence=now - heard))
                continue
            # Leave out a node's own row if it only repeats the worst of its aspects.
            found += [row for row in rows if row.aspect or row.level > worst(rows[1:])]
        known = {node.rpartition('/')[0] for node in nodes}
        for lane in known | expected.keys() or {self._namespace}:
            silence = 0.0 if lane in known else now - expected.get(lane, now)
            overdue = silence if silence > _SILENCE else 0.0
            for name in STAGES:
                node = f'{lane}/{name}'.lstrip('/')
                if node not in nodes:
                    text = 'never heard; start it, in this namespace and ROS_DOMAIN_ID'
                    found.append(Row(node, '', Level.STALE, text, silence=overdue))
        return sorted(found, key=lambda row: (-_URGENCY.index(row.level), row.node, row.aspect))


def worst(rows: Iterable[Row]) -> Level:
    """Return the highest level of the rows."""
    return max((row.level for row in rows), default=Level.OK)


@dataclass(frozen=True, slots=True)
class LaneRow:
    """State of one lane: its worst row and its verdicts."""

    lane: str  # namespace, '/' for none
    level: Level
    verdicts: tuple[tuple[str, str], ...]  # number of each decision
    worst: str  # node, aspect and message; empty if there is no problem

    @property
    def counts(self) -> tuple[int, int, int]:
        """Items accepted, rejected for their mass, and faults."""
        counts = {name: int(float(count)) for name, count in self.verdicts}
        accepted, faults = (counts.pop(each.name, 0) for each in (Decision.ACCEPT, Decision.FAULT))
        return accepted, sum(counts.values()), faults


def by_lane(rows: Iterable[Row]) -> list[LaneRow]:
    """Return a row for each lane, worst first, from the rows of a board in their order."""
    lanes: dict[str, list[Row]] = {}
    for row in rows:
        lanes.setdefault(row.node.rpartition('/')[0] or '/', []).append(row)
    return [_lane_row(lane, each) for lane, each in lanes.items()]


def _lane_row(lane: str, rows: list[Row]) -> LaneRow:
    first = rows[0]  # the worst
    text = f'{first.node.rpartition("/")[2]} {first.aspect}: {first.message}'
    verdicts = tuple(
        (key, value)
        for row in rows
        if row.aspect == 'Verdicts'
        for key, value in row.values
        if key in Decision.__members__
    )
    return LaneRow(lane, first.level, verdicts, text if first.level > Level.OK else '')


def headline(rows: Iterable[Row]) -> str:
    """Return a line with the number of rows of each level."""
    counts = Counter(row.level for row in rows)
    errors, warnings = counted(counts[Level.ERROR], 'error'), counted(counts[Level.WARN], 'warning')
    return f'{counts[Level.STALE]} silent, {errors}, {warnings}, {counts[Level.OK]} well'
