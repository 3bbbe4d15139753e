# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the diagnostics of a running line, the worst first, and what to check.

Examples
--------
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
from checkweigher_core.printable import counted

if TYPE_CHECKING:
    from checkweigher_core.ros.status_board import Row, StatusBoard

_PERIOD = 1.0  # s
_PATIENCE = 5.0  # maximum time in s to wait for the diagnostics of all stages of a line
_FIRST_LOOK = 1.5  # further time in s to wait for the diagnostics of the other nodes
_NARROWEST = 40  # minimum width of the messages in a table, in columns
_COLUMNS = '{:5}  {:{wide}}  {:{aspects}}  '

OPTIONS = (
    ('--namespace NAME', str, 'namespace of the only lane to show; default: all lanes', ''),
    ('--all', bool, 'show one row for each lane, the worst first'),
    ('--count N', int, 'end after N tables; one table is shown each second'),
    DURATION,
    ('--values', bool, 'show the values of all rows, also of those with the level OK'),
)


def run(arguments: argparse.Namespace) -> int:
    """Print tables until a signal arrives, or an option ends the command.

    Returns 1 if a node reports an error, or is silent at the end, otherwise 0.
    """
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
    # The worst level is STALE until each stage of the line has sent diagnostics, so wait for these
    # diagnostics before the first table.
    while time.monotonic() < patience and worst(board.rows(time.monotonic())) == Level.STALE:
        time.sleep(0.05)
    if board.heard:
        time.sleep(_FIRST_LOOK)
    for shown in count(1):
        rows = board.rows(time.monotonic())
        _print(rows, arguments, heard=board.heard)
        if shown == arguments.count or time.monotonic() >= end:
            return
        time.sleep(_PERIOD)


def _print(rows: 'list[Row]', arguments: argparse.Namespace, *, heard: bool) -> None:
    from checkweigher_core.ros.status_board import headline

    lines = [time.strftime('%Y-%m-%d %H:%M:%S  ') + headline(rows)]
    if not heard:
        lines.append('no message on /diagnostics: is the line running in this ROS_DOMAIN_ID?')
    width, height = get_terminal_size()
    if arguments.all:
        lines += lane_table(rows, width)
    else:
        lines += table(rows, width, values=arguments.values)
    if sys.stdout.isatty() and arguments.count != 1:
        # Leave out the last lines of a table that is longer than the terminal. Otherwise the first
        # rows, which are the worst, would scroll out of sight.
        if (left := len(lines) - (height - 2)) > 0:
            lines[height - 2 :] = [f'{counted(left, "more line")}: --count 1 prints all']
        print('\033[H\033[J' + '\n'.join(lines), flush=True)
    else:
        print('\n'.join(lines), end='\n' if arguments.count == 1 else '\n\n', flush=True)


def lane_table(rows: 'Iterable[Row]', width: int) -> Iterator[str]:
    """Yield the lines of a table with one row for each lane.

    The lines are at most `width` columns wide. If less than `_NARROWEST` columns would remain for
    the messages, the messages get `_NARROWEST` columns, and the lines are wider than `width`.
    """
    from checkweigher_core.ros.status_board import by_lane

    lanes = by_lane(rows)
    wide = max([len(each.lane) for each in lanes] + [10])
    columns = f'{{:5}}  {{:{wide}}}  {{:>7}}  {{:>7}}  {{:>7}}  '
    first = columns.format('level', 'lane', 'accept', 'reject', 'fault')
    yield first + 'worst message'
    for each in lanes:
        start = columns.format(each.level.name, each.lane, *each.counts)
        yield from _beside(start, _wrapped(each.worst, max(width - len(start), _NARROWEST)))


def table(rows: 'Iterable[Row]', width: int, *, values: bool) -> Iterator[str]:
    """Yield the lines of a table of diagnostics.

    The lines are at most `width` columns wide. If less than `_NARROWEST` columns would remain for
    the messages, the messages get `_NARROWEST` columns, and the lines are wider than `width`. Rows
    that are not OK also show their values. With `values`, all rows show their values.
    """
    from checkweigher_core.health.findings import Level

    rows = list(rows)
    wide = max([len(row.node) for row in rows] + [10])
    aspects = max([len(row.aspect) for row in rows] + [6])
    first = _COLUMNS.format('level', 'node', 'aspect', wide=wide, aspects=aspects)
    yield first + 'state, and what to check'
    room = max(width - len(first), _NARROWEST)
    for row in rows:
        lines = _wrapped(row.message, room)
        if values or row.level != Level.OK:
            lines += textwrap.wrap(', '.join(f'{key} {value}' for key, value in row.values), room)
        level = row.level.name
        start = _COLUMNS.format(level, row.node, row.aspect, wide=wide, aspects=aspects)
        yield from _beside(start, lines)


def _wrapped(message: str, room: int) -> list[str]:
    """Return the lines of a message, at most `room` columns wide.

    The text after the first semicolon is the hint, which begins on a new line.
    """
    text, _, hint = message.partition('; ')
    lines = textwrap.wrap(text, room) or ['']
    return lines + textwrap.wrap('-> ' + hint, room, subsequent_indent='   ') if hint else lines


def _beside(start: str, lines: list[str]) -> Iterator[str]:
    """Yield lines of text. The first line follows `start`, and spaces precede the other lines."""
    yield (start + lines[0]).rstrip()
    yield from (' ' * len(start) + line for line in lines[1:])
