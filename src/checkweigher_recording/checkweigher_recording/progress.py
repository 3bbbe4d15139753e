# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Progress bar for a long computation, with the time that is left."""

from collections.abc import Callable, Iterable, Iterator, Sized
import sys
from typing import Any, TypeVar

T = TypeVar('T')

_DELAY = 1.0  # delay of the bar in s
_FORMAT = '{desc}: {percentage:3.0f}%|{bar}| {elapsed}, about {remaining} left'


def with_progress(
    items: Iterable[T],
    doing: str,
    total: float | None = None,
    *,
    size: Callable[[T], float] | None = None,
    shown: bool = True,
) -> Iterable[T]:
    """Return an iterable over the same items that shows a progress bar.

    The bar appears only on a terminal, and only after one second. `total` is the number of items,
    which is needed if `items` has no length. If the items take unequal time, `size` returns the
    share of an item, and `total` is the sum of the shares. If `shown` is False, no bar appears.
    """
    if not shown or not sys.stderr.isatty():
        return items
    from tqdm import tqdm  # imported late, because the import is slow

    total = len(items) if total is None and isinstance(items, Sized) else total
    # The time left follows from the mean speed, because the latest items may be unlike the others.
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
