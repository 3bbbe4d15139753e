# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Failures of a stage on an item: the item becomes a FAULT, and the stage continues."""

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
    """Rule for the exceptions of a stage.

    The stages do all their work on items through this class. If the work raises an exception,
    `fault` makes the result of the item, with the reason StageFailed, and `report` gets the number
    of the item and the exception. Two such items in a row stop the line, see `RejectMonitor`.
    """

    report: Callable[[int, Exception], None]

    def each(
        self,
        work: Callable[..., B],
        fault: Callable[[A], B],
        items: Iterable[A],
        *more: Iterable[Any],
    ) -> list[B]:
        """Return the results of items, one by one; `more` are further arguments of `work`."""
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
        """Return the results of items, which a stateless `work` processes at once."""
        try:
            return list(work(items))
        except Exception:  # one by one, to find and report the item
            return self.each(lambda item: work([item])[0], fault, items)


PRINTED = Failures(lambda _, error: traceback.print_exception(error))
