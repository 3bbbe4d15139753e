"""Progress of what may take longer than a moment."""

from collections.abc import Iterable
from typing import TypeVar

from tqdm import tqdm

T = TypeVar('T')

_DELAY = 2.0  # s before a bar appears


def with_progress(
    messages: Iterable[T], doing: str, total: int | None = None, *, shown: bool = True
) -> Iterable[T]:
    """Return the same messages, with a bar on a terminal once they take more than two seconds.

    Parameters
    ----------
    messages : iterable
        What is worked through.
    doing : str
        What the bar says.
    total : int or None
        Their number, if it is known.
    shown : bool
        Whether there may be a bar at all; never where stderr is no terminal.
    """
    return tqdm(
        messages,
        desc=doing,
        total=total,
        unit=' messages',
        delay=_DELAY,
        leave=False,
        disable=None if shown else True,
    )
