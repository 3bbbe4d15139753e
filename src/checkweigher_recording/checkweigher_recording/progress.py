# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Display of the progress and remaining time of a computation, as a bar or as lines of text."""

from collections.abc import Callable, Iterable, Iterator, Sized
import math
import os
import re
import sys
import time
from typing import Any, NamedTuple, TypeVar

T = TypeVar('T')

_DELAY = 1.0  # time in s until the bar appears, and twice the least time between two lines
_FORMAT = '{desc}: {percentage:3.0f}%|{bar}| {elapsed}, about {remaining} left'

# Name of the environment variable that selects lines of text instead of a bar.
PROGRESS = 'CHECKWEIGHER_PROGRESS'
_LINE = 'progress {:.4f}, {:.1f} s left: {}'
_READ = re.compile(r'progress (\S+), (\S+) s left: (.*)')


class Progress(NamedTuple):
    """Progress of a computation."""

    doing: str  # name of the work that the computation does, such as "reading"
    share: float  # completed fraction of the computation, from 0 to 1
    remaining: float  # estimated remaining time in s, NaN if it is not known


def read_progress(line: str) -> Progress | None:
    """Return the progress that a line of `with_progress` states, or None for any other line."""
    if (found := _READ.fullmatch(line)) is None:
        return None
    return Progress(found[3], float(found[1]), float(found[2]))


def with_progress(
    items: Iterable[T],
    doing: str,
    total: float | None = None,
    *,
    size: Callable[[T], float] | None = None,
    shown: bool = True,
) -> Iterable[T]:
    """Return an iterable that yields `items` and shows a progress bar.

    The bar appears only if the standard error stream is a terminal, and only after one second. If
    the environment variable CHECKWEIGHER_PROGRESS is set and `total` is known and not 0, lines of
    text are printed to the standard output instead, which `read_progress` can parse.

    `total` is the number of items. By default, `total` is the length of `items`, or unknown if
    `items` has no length. If the items take unequal time, `size` returns the amount of work of an
    item, and the caller must pass the sum of these amounts as `total`. If `shown` is False, neither
    a bar nor lines appear.
    """
    total = len(items) if total is None and isinstance(items, Sized) else total
    if shown and total and PROGRESS in os.environ:
        return _printed(items, doing, total, size)
    if not shown or not sys.stderr.isatty():
        return items
    # Import tqdm late, because the import is slow.
    from tqdm import tqdm

    # With `smoothing=0`, the remaining time is estimated from the mean speed since the start. The
    # speed of the latest items alone varies too much for an estimate.
    bar = tqdm(
        items,
        doing,
        total,
        bar_format=None if total is None else _FORMAT,
        delay=_DELAY,
        leave=False,
        miniters=0,
        smoothing=0,
    )
    return bar if size is None else _sized(bar, items, size)


def _sized(bar: Any, items: Iterable[T], size: Callable[[T], float]) -> Iterator[T]:
    with bar:
        for item in items:
            yield item
            bar.update(size(item))


def _printed(
    items: Iterable[T], doing: str, total: float, size: Callable[[T], float] | None
) -> Iterator[T]:
    begun, done, latest = time.monotonic(), 0.0, -math.inf
    for item in items:
        yield item
        now = time.monotonic()
        done += 1.0 if size is None else size(item)
        if now - latest >= _DELAY / 2:
            latest = now
            share = min(done / total, 1.0)
            left = (now - begun) * (1 / share - 1) if share else math.nan
            print(_LINE.format(share, left, doing), flush=True)
