# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Progress bar for a long computation."""

from collections.abc import Iterable
import sys
from typing import TypeVar

T = TypeVar('T')

_DELAY = 1.0  # delay of the bar in s


def with_progress(
    items: Iterable[T],
    doing: str,
    total: int | None = None,
    *,
    unit: str = 'messages',
    shown: bool = True,
) -> Iterable[T]:
    """Return an iterable over the same items that shows a progress bar.

    The bar appears only on a terminal, and only after one second. `total` is the number of items,
    which is needed if `items` has no length. If `shown` is False, no bar appears.
    """
    if not shown or not sys.stderr.isatty():
        return items
    from tqdm import tqdm  # imported late, because the import is slow

    return tqdm(items, desc=doing, total=total, unit=f' {unit}', delay=_DELAY, leave=False)
