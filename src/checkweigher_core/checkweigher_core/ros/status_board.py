# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Latest diagnostics of the nodes of one or more lanes, sorted by severity."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
import math
import threading
from typing import Any

from checkweigher_core.health.findings import Level
from checkweigher_core.printable import counted, one_line
from checkweigher_core.records import Decision
from checkweigher_core.ros.ports import NODES, STAGES

HOST = 'host'  # key of the host name in the first status of a message
_SILENCE = 3.0  # time in s without diagnostics after which a node counts as silent
_URGENCY = (Level.OK, Level.WARN, Level.STALE, Level.ERROR)  # levels by increasing severity


def number_of(value: str) -> float:
    """Return the number in a value of a DiagnosticStatus, or NaN if the value is other text.

    Any node may publish any text on /diagnostics, so an invalid value must not raise an exception
    in a program that reads the diagnostics. Infinities are returned as NaN.
    """
    try:
        number = float(value)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan


@dataclass(frozen=True, slots=True)
class Row:
    """Latest status of one aspect of one node."""

    node: str
    aspect: str
    level: Level
    message: str
    values: tuple[tuple[str, str], ...] = ()
    # Time in s since the last message of a silent node or, if no node of the lane has sent a
    # message, since the last call of `StatusBoard.expect`. A time that is unknown or at most 3 s is
    # replaced by 0.
    silence: float = 0.0


class StatusBoard:
    """Latest diagnostics of each node of the lane `namespace`, or of all lanes if it is empty."""

    def __init__(self, namespace: str = '') -> None:
        self._namespace = namespace
        self._nodes: dict[str, tuple[float, list[Row]]] = {}
        self._expected: dict[str, float] = {}  # time in s of the last call of `expect` for a lane
        self._lock = threading.Lock()

    def add(self, now: float, statuses: Iterable[Any]) -> None:
        """Add the statuses of a DiagnosticArray that arrived at time `now` in s.

        Statuses of nodes that are not in `ports.NODES`, or not in the lane of the board, are
        ignored.
        """
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
        """Treat the nodes of a lane as silent since time `now` in s.

        The nodes are treated as silent until one of them sends a message.
        """
        with self._lock:
            self._expected[lane] = now

    def hosts(self) -> dict[str, set[str]]:
        """Return the host names of the nodes of each lane."""
        found: dict[str, set[str]] = {}
        with self._lock:
            for node, (_, rows) in self._nodes.items():
                found.setdefault(node.rpartition('/')[0], set()).update(
                    value for row in rows for key, value in row.values if key == HOST
                )
        return found

    @property
    def heard(self) -> bool:
        """Whether a message of any node has arrived."""
        return bool(self._nodes)

    def rows(self, now: float) -> list[Row]:
        """Return all rows at time `now` in s, sorted from the worst to the best.

        A node that has been silent for more than 3 s, or a stage that has sent no message, has only
        one row, which is STALE.
        """
        with self._lock:
            nodes, expected = dict(self._nodes), dict(self._expected)
        found = [row for node, report in nodes.items() for row in _rows_of(node, *report, now)]
        known = {node.rpartition('/')[0] for node in nodes}
        for lane in known | expected.keys() or {self._namespace}:
            silence = 0.0 if lane in known else now - expected.get(lane, now)
            overdue = silence if silence > _SILENCE else 0.0
            text = 'has sent no diagnostics; start it in this namespace and ROS_DOMAIN_ID'
            found += [
                Row(node, '', Level.STALE, text, silence=overdue)
                for node in (f'{lane}/{name}'.lstrip('/') for name in STAGES)
                if node not in nodes
            ]
        return sorted(found, key=lambda row: (-_URGENCY.index(row.level), row.node, row.aspect))


def _rows_of(node: str, heard: float, rows: list[Row], now: float) -> list[Row]:
    """Return the rows of a node, whose last message was received at time `heard` in s.

    A node that has been silent for more than 3 s has only one row.
    """
    if now - heard > _SILENCE:
        text = f'silent for {now - heard:.0f} s; its process hangs or has ended; restart it'
        return [Row(node, '', Level.STALE, text, silence=now - heard)]
    # Leave out the first row, which describes the whole node, unless its level is higher than the
    # levels of the other rows.
    return [row for row in rows if row.aspect or row.level > worst(rows[1:])]


def worst(rows: Iterable[Row]) -> Level:
    """Return the highest level of the rows, or OK without rows."""
    return max((row.level for row in rows), default=Level.OK)


@dataclass(frozen=True, slots=True)
class LaneRow:
    """State of one lane: its worst row and its verdicts."""

    lane: str  # namespace; '/' if it is empty
    level: Level
    verdicts: tuple[tuple[str, str], ...]  # names of decisions, each with the number of items
    worst: str  # node, aspect and message of the worst row; empty if there is no problem

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of accepted items, of items rejected because of their mass, and of faults."""
        counts = {name: int(number_of(count)) for name, count in self.verdicts}
        accepted, faults = (counts.pop(each.name, 0) for each in (Decision.ACCEPT, Decision.FAULT))
        return accepted, sum(counts.values()), faults


def by_lane(rows: Iterable[Row]) -> list[LaneRow]:
    """Return a row for each lane, made from the sorted rows of a `StatusBoard`.

    The lanes are in the order of their worst rows, with the worst lane first.
    """
    lanes: dict[str, list[Row]] = {}
    for row in rows:
        lanes.setdefault(row.node.rpartition('/')[0] or '/', []).append(row)
    return [_lane_row(lane, each) for lane, each in lanes.items()]


def _lane_row(lane: str, rows: list[Row]) -> LaneRow:
    first = rows[0]  # the worst row
    place = f'{first.node.rpartition("/")[2]} {first.aspect}'.rstrip()
    text = f'{place}: {first.message}'
    verdicts = tuple(
        (key, value)
        for row in rows
        if row.aspect == 'Verdicts'
        for key, value in row.values
        if key in Decision.__members__ and math.isfinite(number_of(value))
    )
    return LaneRow(lane, first.level, verdicts, text if first.level > Level.OK else '')


def headline(rows: Iterable[Row]) -> str:
    """Return one line with the number of rows of each level."""
    counts = Counter(row.level for row in rows)
    errors, warnings = counted(counts[Level.ERROR], 'error'), counted(counts[Level.WARN], 'warning')
    return f'{counts[Level.STALE]} silent, {errors}, {warnings}, {counts[Level.OK]} well'
