"""What `status` shows of the diagnostics of running lines."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
import shutil
import sys
import textwrap
import threading
import time
from typing import Any

from rclpy.node import Node

from checkweigher_bringup.spinning import spinning
from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.ros import ports

_NEEDED = ('segmenter', 'denoise', 'identifier', 'reject')
_OURS = (*_NEEDED, 'driver', 'product')
_SILENCE = 3.0  # s, three of its periods
_PERIOD = 1.0  # s
_PATIENCE = 5.0  # s, in which the first word of a line that lives comes
_FIRST_LOOK = 1.5  # s from then on, in which every node has told of itself
_NARROWEST = 40  # columns of text
_COLUMNS = '{:5}  {:{wide}}  {:12}  '


@dataclass(frozen=True, slots=True)
class Row:
    """One aspect of one node, as it was told at ``heard``, s of the monotonic clock."""

    node: str
    aspect: str
    level: Level
    message: str
    values: tuple[tuple[str, str], ...] = ()
    heard: float = 0.0


class Watch:
    """Keep the last that each node of the lines has told.

    Parameters
    ----------
    namespace : str
        The only lane to show; empty for all.
    """

    def __init__(self, namespace: str = '') -> None:
        self._namespace = namespace
        self._nodes: dict[str, tuple[float, list[Row]]] = {}
        self._lock = threading.Lock()

    def add(self, now: float, statuses: Iterable[Any]) -> None:
        """Take the statuses of one DiagnosticArray that came at `now`, s."""
        told: dict[str, list[Row]] = {}
        for status in statuses:
            node, _, aspect = str(status.name).partition(': ')
            lane, _, name = node.strip('/').rpartition('/')
            if name in _OURS and self._namespace in ('', lane):
                values = tuple((str(v.key), str(v.value)) for v in status.values)
                level = Level(min(status.level[0], Level.STALE))
                row = Row(node, aspect, level, str(status.message), values, now)
                told.setdefault(node, []).append(row)
        with self._lock:
            for node, rows in told.items():
                self._nodes[node] = now, rows

    @property
    def heard(self) -> bool:
        """Whether anybody has told anything."""
        return bool(self._nodes)

    def rows(self, now: float) -> list[Row]:
        """Return all rows at `now`, s, the worst first; silent and missing nodes are STALE."""
        with self._lock:
            nodes = dict(self._nodes)
        found = []
        for node, (heard, rows) in nodes.items():
            if now - heard > _SILENCE:
                text = f'silent for {now - heard:.0f} s; its process hangs or has ended, start it'
                found.append(Row(node, '', Level.STALE, text))
                continue
            # The node's own row repeats the worst of the others, but for a warning of this second.
            found += [row for row in rows if row.aspect or row.level > _worst(rows[1:])]
        lanes = {node.rpartition('/')[0] for node in nodes} or {self._namespace}
        for lane in lanes:
            for name in _NEEDED:
                node = f'{lane}/{name}'.lstrip('/')
                if node not in nodes:
                    text = 'never heard; start it, in this namespace and ROS_DOMAIN_ID'
                    found.append(Row(node, '', Level.STALE, text))
        return sorted(found, key=lambda row: (-_urgency(row.level), row.node, row.aspect))


def _urgency(level: Level) -> int:
    """Order of the levels: what has failed, then who is silent, then what may fail."""
    return (Level.OK, Level.WARN, Level.STALE, Level.ERROR).index(level)


def _worst(rows: Iterable[Row]) -> Level:
    return max((row.level for row in rows), default=Level.OK)


def headline(rows: Iterable[Row]) -> str:
    """Return how many rows there are of each level."""
    counts = dict.fromkeys(reversed(Level), 0)
    for row in rows:
        counts[row.level] += 1
    names: Mapping[Level, str] = {
        Level.STALE: 'silent', Level.ERROR: 'errors', Level.WARN: 'warnings', Level.OK: 'well',
    }  # fmt: skip
    return ', '.join(f'{count} {names[level]}' for level, count in counts.items())


def table(rows: Iterable[Row], width: int, *, values: bool) -> Iterator[str]:
    """Yield the lines of a table, `width` columns wide if that leaves room for the text.

    What is not well shows its hint and its figures; with `values` the rest shows them, too.
    """
    rows = list(rows)
    wide = max([len(row.node) for row in rows] + [10])
    first = _COLUMNS.format('level', 'node', 'aspect', wide=wide)
    indent = ' ' * len(first)
    yield first + 'what is, and what to check'
    room = max(width - len(indent), _NARROWEST)
    for row in rows:
        text, _, hint = row.message.partition('; ')
        begin = _COLUMNS.format(row.level.name, row.node, row.aspect, wide=wide)
        lines = textwrap.wrap(text, room) or ['']
        if hint:
            lines += textwrap.wrap('-> ' + hint, room, subsequent_indent='   ')
        if values or row.level != Level.OK:
            figures = ', '.join(f'{key} {value}' for key, value in row.values)
            lines += textwrap.wrap(figures, room)
        yield begin + lines[0]
        yield from (indent + line for line in lines[1:])


def watch(
    namespace: str, count: int | None, duration: float | None, *, values: bool = False
) -> bool:
    """Print a table a second.

    Parameters
    ----------
    namespace : str
        The only lane to show; empty for all.
    count : int or None
        Tables after which to end.
    duration : float or None
        s after which to end.
    values : bool
        Whether to show the figures of what is well.

    Returns
    -------
    bool
        Whether the last table had neither an error nor a silent node.
    """
    seen = Watch(namespace)
    began = time.monotonic()
    shown, rows = 0, seen.rows(began)
    with spinning() as spinner:
        node = Node('status')
        topic = ports.DIAGNOSTICS
        node.create_subscription(
            topic.type, topic.name, lambda m: seen.add(time.monotonic(), m.status), topic.qos
        )
        spinner.add(node)
        try:
            _wait_for_the_first(seen, began + min(_PATIENCE, duration or _PATIENCE))
            while True:
                rows = seen.rows(time.monotonic())
                _print(rows, values=values, heard=seen.heard)
                shown += 1
                over = duration is not None and time.monotonic() - began >= duration
                if over or shown == count:
                    break
                time.sleep(_PERIOD)
        except KeyboardInterrupt:
            pass
    return _worst(rows) < Level.ERROR


def _wait_for_the_first(seen: Watch, end: float) -> None:
    """Wait until a line has told of itself, at most until `end`, s of the monotonic clock."""
    while not seen.heard and time.monotonic() < end:
        time.sleep(0.05)
    if seen.heard:
        time.sleep(_FIRST_LOOK)


def _print(rows: list[Row], *, values: bool, heard: bool) -> None:
    screen = sys.stdout.isatty()
    lines = [time.strftime('%Y-%m-%d %H:%M:%S  ') + headline(rows)]
    if not heard:
        lines.append('nothing on /diagnostics: is the line running, and in this ROS_DOMAIN_ID?')
    lines += table(rows, shutil.get_terminal_size().columns, values=values)
    clear = '\033[H\033[J' if screen else ''
    print(clear + '\n'.join(lines) + ('' if screen else '\n'), flush=True)
