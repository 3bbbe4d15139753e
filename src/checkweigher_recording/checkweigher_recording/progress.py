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

    Parameters
    ----------
    items : iterable
        What is worked through.
    doing : str
        Label of the bar.
    total : int or None
        Number of items; None if it is not known, or is their length.
    unit : str
        Name of the items.
    shown : bool
        Whether there may be a bar at all; never where stderr is no terminal.
    """
    if not shown or not sys.stderr.isatty():
        return items
    from tqdm import tqdm  # its import takes as long as reading a short bag

    return tqdm(items, desc=doing, total=total, unit=f' {unit}', delay=_DELAY, leave=False)
