# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Why the latest item of a lane is no news: nothing weighs there any more."""

from collections.abc import Sequence

from checkweigher_core.ros.ports import STAGES
from checkweigher_core.ros.status_board import Row

_WEIGHS = ('driver', *STAGES)
# By the state of the driver.
_ENDED = {
    'inactive': 'weighing is stopped',
    'finished': 'weighing has ended, for the source has',
    'failed': 'weighing has ended, for the source has failed',
}


def standstill(rows: Sequence[Row]) -> str:
    """Return why a lane does not weigh, by what its nodes have told; empty while it does."""
    silence = max((row.silence for row in rows if _name(row) in _WEIGHS), default=0.0)
    if silence:
        return f'silent for {silence:.0f} s'
    states = (
        dict(row.values).get('state', '')
        for row in rows
        if (_name(row), row.aspect) == ('driver', 'Source')
    )
    return _ENDED.get(next(states, ''), '')


def _name(row: Row) -> str:
    return row.node.rpartition('/')[2]
