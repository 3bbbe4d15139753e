# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Progress of a long computation with its remaining time, as a bar or as lines of text."""

from collections.abc import Callable, Iterable, Iterator, Sized
import math
import os
import re
import sys
import time
from typing import Any, NamedTuple, TypeVar

T = TypeVar('T')

_DELAY = 1.0  # delay of the bar in s
_FORMAT = '{desc}: {percentage:3.0f}%|{bar}| {elapsed}, about {remaining} left'

PROGRESS = 'CHECKWEIGHER_PROGRESS'  # environment variable that is set for lines instead of a bar
_LINE = 'progress {:.4f}, {:.1f} s left: {}'
_READ = re.compile(r'progress (\S+), (\S+) s left: (.*)')


class Progress(NamedTuple):
    """Progress of a computation."""

    doing: str
    share: float  # fraction that is done, from 0 to 1
    remaining: float  # estimated remaining time in s, NaN if it is not known


def read_progress(line: str) -> Progress | None:
    """Return the progress in a line that `with_progress` has printed, or None for other lines."""
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
    """Return an iterable over the same items that shows a progress bar.

    The bar appears only on a terminal, and only after one second. If the environment variable
    `PROGRESS` is set, lines for `read_progress` are printed instead. `total` is the number of
    items, which is needed if `items` has no length. If the items take unequal time, `size` returns
    the share of an item, and `total` is the sum of the shares. If `shown` is False, no bar appears.
    """
    total = len(items) if total is None and isinstance(items, Sized) else total
    if shown and total and PROGRESS in os.environ:
        return _printed(items, doing, total, size)
    if not shown or not sys.stderr.isatty():
        return items
    from tqdm import tqdm  # imported late, because the import is slow

    # The remaining time is based on the mean speed, because the speed of single items varies.
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
