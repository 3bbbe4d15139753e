"""Progress of what may take longer than a moment."""

from collections.abc import Iterable, Iterator, Sized
import sys
import time
from typing import TypeVar

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
    if not shown or not sys.stderr.isatty():
        return messages
    return _watched(messages, doing, total, unit)


def _watched(messages: Iterable[T], doing: str, total: int | None, unit: str) -> Iterator[T]:
    begin, count = time.monotonic(), 0
    if total is None and isinstance(messages, Sized):
        total = len(messages)
    rest = iter(messages)
    for message in rest:
        yield message
        count += 1
        if time.monotonic() - begin > _DELAY:
            break
    else:
        return
    # Its import takes as long as most of what is over by now.
    from tqdm import tqdm

    yield from tqdm(rest, desc=doing, total=total, initial=count, unit=f' {unit}', leave=False)
