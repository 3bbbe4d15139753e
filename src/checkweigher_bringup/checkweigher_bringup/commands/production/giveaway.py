# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the giveaway in kg and in money by shift, day or month.

Examples
--------
checkweigher giveaway /var/lib/checkweigher/lane1/batches --by day --price 4.20
"""

import argparse
from datetime import time
from functools import partial
import math
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.errors import UserError, warn

if TYPE_CHECKING:
    from checkweigher_validation.batch.giveaway import Period

_SHIFTS = '06:00 14:00 22:00'
OPTIONS = (
    ('records RECORD', [Path], 'records of batches, or folders of records'),
    ('--by', ('shift', 'day', 'month'), 'period, of the local time; default day', 'day'),
    ('--shifts TIMES', str, f'times at which shifts begin; default {_SHIFTS}', _SHIFTS),
    ('--price P', float, 'price per kg, instead of those of the recipes', math.nan),
    (
        '--log LOG',
        Path,
        'audit log to compare the records with; default: audit.log in the folder of the machine',
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Print the giveaway of each period. Return 1 if a record cannot be trusted, otherwise 0."""
    from checkweigher_bringup.batch_report import record_files
    from checkweigher_core.printable import one_line
    from checkweigher_validation.batch.batch import read_recorded
    from checkweigher_validation.batch.giveaway import giveaway

    paths = [path for source in arguments.records for path in record_files(source)]
    if not paths:
        raise UserError('there is no record of a batch')
    period = _period(arguments)
    batches = [read_recorded(path, arguments.log) for path in paths]
    print(f'{"period":16} {"product":20} {"items":>8} {"nominal kg":>12} {"giveaway kg":>12} money')
    for each in giveaway(batches, period, arguments.price):
        money = '-' if math.isnan(each.money) else f'{each.money:.2f}'
        print(
            f'{each.period:16} {one_line(each.product):20} {each.items:8} {each.nominal:12.3f} '
            f'{each.surplus:+12.3f} {money}'
        )
    for path, batch in zip(paths, batches, strict=True):
        if batch.faults:
            warn(f'{path}: NOT trusted: {one_line(batch.faults[0])}')
    return int(any(batch.faults for batch in batches))


def _period(arguments: argparse.Namespace) -> 'Period':
    from checkweigher_validation.batch import giveaway

    if arguments.by != 'shift':
        return giveaway.day if arguments.by == 'day' else giveaway.month
    try:
        begins = [time.fromisoformat(each) for each in arguments.shifts.split()]
    except ValueError:
        begins = []
    if not begins:
        raise UserError(f'--shifts {arguments.shifts!r}: must be times such as 06:00 14:00')
    return partial(giveaway.shift, begins=begins)
