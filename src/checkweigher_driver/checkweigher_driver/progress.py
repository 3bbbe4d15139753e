"""Progress of what may take longer than a moment."""

from collections.abc import Iterable
from typing import TypeVar

from tqdm import tqdm

T = TypeVar('T')

_DELAY = 2.0  # s before a bar appears


def with_progress(
    messages: Iterable[T], doing: str, total: int | None = None, *, unit: str = 'messages',
    shown: bool = True,
) -> Iterable[T]:  # fmt: skip
    """Return the same messages, with a bar on a terminal once they take more than two seconds.

    Parameters
    ----------
    messages : iterable
        What is worked through.
    doing : str
        What the bar says.
    total : int or None
        Their number; None if it is not known, or is their length.
    unit : str
        What they are.
    shown : bool
        Whether there may be a bar at all; never where stderr is no terminal.
    """
    return tqdm(
        messages,
        desc=doing,
        total=total,
        unit=f' {unit}',
        delay=_DELAY,
        leave=False,
        disable=None if shown else True,
    )
