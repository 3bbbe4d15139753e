# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""SQLite bags: they have no check sums, so what can be compared is compared.

SQLite's own check finds damaged pages, and an index of times that does not fit its table. A number
in a message that was damaged shows where it does not fit those beside it: a stamp and the time at
which its message was logged, an index and its stamp, a count and the counts before and after it.
"""

from collections.abc import Sequence
from contextlib import closing
import math
from pathlib import Path
import sqlite3
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.input_files import open_input
from checkweigher_dsp.records import NANOSECONDS
from checkweigher_recording.bags.bounds import LARGEST_FILE, LARGEST_RECORD
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.recording import BlockColumns

NO_CHECK_SUMS = (
    'an SQLite bag has no check sums: damage that fits the numbers beside it is another mass; '
    'record MCAP (ros2 bag record -s mcap)'
)
_MOST_TABLES = 100
# Times what is usual beside it: no sample of a belt scale was seen above 10.
_UNUSUAL = 20.0
_BESIDE = 64  # samples whose noise is taken together
_NEIGHBOURS = 7  # messages, an odd number
_PIECE = 1 << 18  # samples or messages that are compared at a time
# ns; where stamps and times of logging agree to a rounding, and where they do not: a busy machine
# may be late with one message.
_ROUNDING, _LATE = 1000, NANOSECONDS // 4


def check_sqlite(path: Path) -> None:
    """Check a ``.db3`` file: plain tables, and what SQLite itself can check.

    Raises
    ------
    BagError
        If it is damaged or holds what no recorder writes.
    OSError
        If it cannot be read.
    """
    open_input(path, LARGEST_FILE).close()
    name = f'file:{quote(str(path.absolute()))}?mode=ro&immutable=1'
    try:
        with closing(sqlite3.connect(name, uri=True)) as connection:
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_RECORD)
            connection.execute('PRAGMA trusted_schema = OFF')
            found = connection.execute('SELECT type, sql FROM sqlite_schema')
            tables = found.fetchmany(_MOST_TABLES)
            if len(tables) == _MOST_TABLES or not all(map(_is_plain, tables)):
                raise BagError(f'{path}: not a bag: it has views or the like')
            (problem,) = connection.execute('PRAGMA integrity_check(1)').fetchone()
    except sqlite3.Error as error:
        problem = str(error)
    if problem != 'ok':
        raise BagError(f'{path}: damaged: {" ".join(problem.split())}; restore the file')


def _is_plain(table: tuple[str, str | None]) -> bool:
    kind, text = table
    words = (text or '').upper().split()
    return kind == 'index' or (kind == 'table' and words[:2] == ['CREATE', 'TABLE'])


def doubtful_stamps(logged: Sequence[int], stamps: Sequence[int]) -> NDArray[np.bool_]:
    """Return which messages of a topic, (n,), were logged at a time that does not fit their stamp.

    Both are in ns and in the order of logging. A recorder that was late was late for the messages
    beside as well.
    """
    delay = np.asarray(logged, np.int64) - np.asarray(stamps, np.int64)
    apart = np.abs(delay - _median_beside(delay))
    return _far(apart, _ROUNDING, _LATE)


def sample_rate(blocks: BlockColumns) -> float:
    """Return the sample rate in Hz by the stamps of blocks in canonical order; NaN of one block."""
    steps = np.diff(blocks.first_indices).view(np.int64)
    times = np.diff(blocks.stamps)[steps > 0] / steps[steps > 0]
    return NANOSECONDS / float(np.median(times)) if np.any(times) else math.nan


def doubtful_blocks(blocks: BlockColumns, sample_rate: float) -> NDArray[np.bool_]:
    """Return which blocks, in canonical order, have an index or a count that does not fit."""
    if not len(blocks):
        return np.zeros(0, bool)
    period = NANOSECONDS / sample_rate
    # Modulo 2^64, as the index counts: what a damaged one is off by may be anything.
    index = (blocks.first_indices - blocks.first_indices[0]).view(np.int64)
    begin = (blocks.stamps - blocks.stamps[0]) - index * period
    apart = np.abs(begin - _median_beside(begin))
    doubtful = _far(apart, period, _LATE // 10)
    places = _unusual_counts(blocks.counts)
    doubtful[np.searchsorted(blocks.begins, places, side='right') - 1] = True
    return np.asarray(doubtful)


def _far(apart: NDArray[Any], rounding: float, late: float) -> NDArray[np.bool_]:
    usual = np.median(apart) if len(apart) else 0.0
    return np.asarray(apart > (rounding if usual < _ROUNDING else late + _UNUSUAL * usual))


def _unusual_counts(counts: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return the places of single samples that are far from the middle of those beside them."""
    if len(counts) < 3 * _BESIDE:
        return np.zeros(0, np.intp)
    found = []
    for first in range(0, len(counts), _PIECE):  # as floats they take twice the memory
        begin = max(min(first, len(counts) - 3 * _BESIDE) - _BESIDE, 0)
        values = counts[begin : first + _PIECE + _BESIDE].astype(np.float64)
        found.append(begin + np.flatnonzero(_is_unusual(values)))
    return np.unique(np.concatenate(found))


def _is_unusual(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    apart = np.zeros(len(values))
    apart[1:-1] = np.abs(values[1:-1] - 0.5 * (values[:-2] + values[2:]))
    apart[0], apart[-1] = abs(values[0] - values[1]), abs(values[-1] - values[-2])
    parts = len(apart) // _BESIDE
    noise = np.median(apart[: parts * _BESIDE].reshape(parts, _BESIDE), axis=1)
    beside = np.pad(noise, 1, mode='edge')
    noise = np.maximum(np.maximum(beside[:-2], beside[2:]), np.maximum(noise, 2.0))  # counts
    noise = np.repeat(np.append(noise, noise[-1]), _BESIDE)[: len(apart)]
    return np.asarray(apart > _UNUSUAL * noise)


def _median_beside(values: NDArray[Any]) -> NDArray[Any]:
    """Return the median of each value and those beside it."""
    half = _NEIGHBOURS // 2
    padded = np.pad(values, half, mode='reflect' if len(values) > half else 'edge')
    windows = np.lib.stride_tricks.sliding_window_view(padded, _NEIGHBOURS)
    medians = np.empty_like(values)
    for first in range(0, len(values), _PIECE):
        piece = slice(first, first + _PIECE)
        medians[piece] = np.sort(windows[piece], axis=1)[:, half]
    return medians
