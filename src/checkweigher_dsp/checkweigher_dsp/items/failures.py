# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Handling of exceptions: a stage that fails on an item rejects the item and continues."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
import traceback
from typing import Any, Protocol, TypeVar


class _Numbered(Protocol):
    @property
    def item_id(self) -> int: ...


A = TypeVar('A', bound=_Numbered)
B = TypeVar('B')


@dataclass(frozen=True, slots=True)
class Failures:
    """Handler of the exceptions that a stage raises while it processes an item.

    If the function `work` raises an exception, the function `fault` returns the result of the item,
    with the reason StageFailed. The function `report` is called with the number of the item and the
    exception. `RejectMonitor` requests a stop after two successive items with the reason
    StageFailed.
    """

    report: Callable[[int, Exception], None]

    def each(
        self,
        work: Callable[..., B],
        fault: Callable[[A], B],
        items: Iterable[A],
        *more: Iterable[Any],
    ) -> list[B]:
        """Apply `work` to each item and its arguments from `more`, and return the results.

        Raises `ValueError` if an iterable in `more` does not have the length of `items`.
        """
        results = []
        for item, *others in zip(items, *more, strict=True):
            try:
                results.append(work(item, *others))
            except Exception as error:
                self.report(item.item_id, error)
                results.append(fault(item))
        return results

    def together(
        self,
        work: Callable[[Sequence[A]], Sequence[B]],
        fault: Callable[[A], B],
        items: Sequence[A],
    ) -> list[B]:
        """Process all items in one call of `work`, and return the results.

        If this call raises an exception, `work` is called again for each item alone. Therefore
        `work` must not keep a state between calls.
        """
        try:
            return list(work(items))
        except Exception:
            # Process the items one by one, so that only items that cause an exception fail.
            return self.each(lambda item: work([item])[0], fault, items)


PRINTED = Failures(lambda _, error: traceback.print_exception(error))
