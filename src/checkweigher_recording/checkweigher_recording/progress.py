# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Progress bars for work that may take some time."""

from collections.abc import Iterable
import sys
from typing import TypeVar

T = TypeVar('T')

_DELAY = 1.0  # s before a bar appears


def with_progress(
    items: Iterable[T],
    doing: str,
    total: int | None = None,
    *,
    unit: str = 'messages',
    shown: bool = True,
) -> Iterable[T]:
    """Return the same items, with a bar on a terminal if they take more than a second.

    `total` is the number of items if they have no length. If `shown` is False, there is no bar.
    """
    if not shown or not sys.stderr.isatty():
        return items
    from tqdm import tqdm  # the import takes as long as reading a short bag

    return tqdm(items, desc=doing, total=total, unit=f' {unit}', delay=_DELAY, leave=False)
