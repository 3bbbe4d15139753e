# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show what is wrong with a running line, worst first, and what to check.

checkweigher status --count 1
"""

import argparse
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import count
import math
from shutil import get_terminal_size
import sys
import textwrap
import time
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import DURATION
from checkweigher_bringup.errors import UserError

if TYPE_CHECKING:
    from checkweigher_core.ros.status_board import Row, StatusBoard

_PERIOD = 1.0  # s
_PATIENCE = 5.0  # maximum time in s to wait for the diagnostics of each stage of a line
_FIRST_LOOK = 1.5  # further time in s to wait for the diagnostics of the other nodes
_NARROWEST = 40  # minimum width of the texts, in columns
_COLUMNS = '{:5}  {:{wide}}  {:12}  '

OPTIONS = (
    ('--namespace NAME', str, 'only this lane', ''),
    ('--all', bool, 'one row for each lane of the graph, the worst first'),
    ('--count N', int, 'end after N tables, one a second'),
    DURATION,
    ('--values', bool, 'show the figures of what is well, too'),
)


def run(arguments: argparse.Namespace) -> int:
    """Print tables until interrupted. Return 1 if a node has an error or is silent, otherwise 0."""
    from checkweigher_bringup.settings import check_namespace, check_positive
    from checkweigher_bringup.spinning import spinning
    from checkweigher_core.health.findings import Level
    from checkweigher_core.ros import ports
    from checkweigher_core.ros.graph.policy import OBSERVER
    from checkweigher_core.ros.port_node import PortNode
    from checkweigher_core.ros.status_board import StatusBoard, worst

    if arguments.all and arguments.namespace:
        raise UserError('--all: shows all lanes, so leave out --namespace')
    check_positive(arguments, 'count', 'duration')
    board = StatusBoard(check_namespace(arguments.namespace))
    with spinning(enclave=OBSERVER) as spinner:
        node = PortNode('status')
        node.subscribe(ports.DIAGNOSTICS, lambda m: board.add(time.monotonic(), m.status))
        spinner.add(node)
        with suppress(KeyboardInterrupt):
            _show_tables(board, arguments)
    return 0 if worst(board.rows(time.monotonic())) < Level.ERROR else 1


def _show_tables(board: 'StatusBoard', arguments: argparse.Namespace) -> None:
    from checkweigher_core.health.findings import Level
    from checkweigher_core.ros.status_board import worst

    end = time.monotonic() + (arguments.duration or math.inf)
    patience = min(time.monotonic() + _PATIENCE, end)
    # The board has the level STALE until each stage of the line has sent diagnostics.
    while time.monotonic() < patience and worst(board.rows(time.monotonic())) == Level.STALE:
        time.sleep(0.05)
    if board.heard:
        time.sleep(_FIRST_LOOK)
    for shown in count(1):
        rows = board.rows(time.monotonic())
        _print(rows, values=arguments.values, heard=board.heard, lanes=arguments.all)
        if shown == arguments.count or time.monotonic() >= end:
            return
        time.sleep(_PERIOD)


def _print(rows: 'list[Row]', *, values: bool, heard: bool, lanes: bool) -> None:
    from checkweigher_core.ros.status_board import headline

    lines = [time.strftime('%Y-%m-%d %H:%M:%S  ') + headline(rows)]
    if not heard:
        lines.append('nothing on /diagnostics: is the line running, and in this ROS_DOMAIN_ID?')
    width = get_terminal_size().columns
    lines += lane_table(rows, width) if lanes else table(rows, width, values=values)
    before, after = ('\033[H\033[J', '\n') if sys.stdout.isatty() else ('', '\n\n')
    print(before + '\n'.join(lines), end=after, flush=True)


def lane_table(rows: 'Iterable[Row]', width: int) -> Iterator[str]:
    """Yield the lines of a table of lanes, cut to `width` columns unless that is too narrow."""
    from checkweigher_core.ros.status_board import by_lane

    lanes = by_lane(rows)
    wide = max([len(each.lane) for each in lanes] + [10])
    columns = f'{{:5}}  {{:{wide}}}  {{:>7}}  {{:>7}}  {{:>7}}  {{}}'
    yield columns.format('level', 'lane', 'accept', 'reject', 'fault', 'the worst of it')
    for each in lanes:
        line = columns.format(each.level.name, each.lane, *each.counts, each.worst)
        yield line[: max(width, wide + _NARROWEST)]


def table(rows: 'Iterable[Row]', width: int, *, values: bool) -> Iterator[str]:
    """Yield the lines of a table of diagnostics.

    The table is `width` columns wide, or wider if the texts would have less than `_NARROWEST`
    columns. Rows that are not OK also show their values. With `values`, all rows show their values.
    """
    from checkweigher_core.health.findings import Level

    rows = list(rows)
    wide = max([len(row.node) for row in rows] + [10])
    first = _COLUMNS.format('level', 'node', 'aspect', wide=wide)
    indent = ' ' * len(first)
    yield first + 'what is, and what to check'
    room = max(width - len(indent), _NARROWEST)
    for row in rows:
        text, _, hint = row.message.partition('; ')
        lines = textwrap.wrap(text, room) or ['']
        if hint:
            lines += textwrap.wrap('-> ' + hint, room, subsequent_indent='   ')
        if values or row.level != Level.OK:
            lines += textwrap.wrap(', '.join(f'{key} {value}' for key, value in row.values), room)
        yield _COLUMNS.format(row.level.name, row.node, row.aspect, wide=wide) + lines[0]
        yield from (indent + line for line in lines[1:])
