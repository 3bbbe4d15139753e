# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Progress bars of what may take longer than a moment."""

from collections.abc import Iterable
import sys
from typing import TypeVar

T = TypeVar('T')

_DELAY = 1.0  # s before a bar appears


def with_progress(
    items: Iterable[T], doing: str, total: int | None = None, *, unit: str = 'messages',
    shown: bool = True,
) -> Iterable[T]:  # fmt: skip
    """Return the same items, with a bar on a terminal once they take more than a second.

    `total` is their number where they have no length; with `shown` False there is never a bar.
    """
    if not shown or not sys.stderr.isatty():
        return items
    from tqdm import tqdm  # its import takes as long as reading a short bag

    return tqdm(items, desc=doing, total=total, unit=f' {unit}', delay=_DELAY, leave=False)
