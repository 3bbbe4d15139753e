# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Columns of a table of item results, and the CSV file with these columns."""

from collections.abc import Callable, Iterable, Iterator
import csv
from dataclasses import dataclass
from enum import Enum
from itertools import chain
import math
import re
from types import SimpleNamespace
from typing import Any

from checkweigher_core.records import GRAMS, NANOSECONDS
from checkweigher_validation.accuracy.results import ItemResult


class ColumnType(Enum):
    """Type of the values of a column."""

    WHOLE = 'whole number'
    TIME = 'time of the bag'  # values are in ns
    NUMBER = 'number'
    TEXT = 'text'
    TEXTS = 'several texts'


@dataclass(frozen=True, slots=True)
class Column:
    """Column of a table of item results."""

    name: str
    kind: ColumnType
    unit: str  # unit in the CSV file, '1' for a number without a unit, empty for texts
    value_of: Callable[[ItemResult], Any]  # function that returns the value for an item
    digits: int = 6  # number of decimal places of a NUMBER in the CSV file

    def value(self, item: ItemResult) -> Any:
        """Return the value for an item, or None if it is unknown. A time is in ns."""
        value = self.value_of(item)
        return None if self.kind is ColumnType.NUMBER and not math.isfinite(value) else value

    def text(self, item: ItemResult) -> str:
        """Return the text for an item in the CSV file, which is empty if the value is unknown."""
        value = self.value(item)
        if value is None:
            return ''
        if self.kind is ColumnType.TIME:
            # Do not use a float, which would round the time in s since 1970 to about 200 ns.
            whole, part = divmod(value, NANOSECONDS)
            return f'{whole}.{part:09d}'
        if self.kind is ColumnType.TEXTS:
            return ';'.join(value)
        return f'{value:.{self.digits}f}' if self.kind is ColumnType.NUMBER else str(value)


_FORMULA = re.compile(r'[=@\t\r]|[-+](?!(\d+(\.\d*)?(e[-+]\d+)?|inf)$)')
_time, _number = ColumnType.TIME, ColumnType.NUMBER
COLUMNS = (
    Column('item_id', ColumnType.WHOLE, '1', lambda item: item.estimate.item_id),
    Column('t1', _time, 's', lambda item: item.estimate.t1),
    Column('t2', _time, 's', lambda item: item.estimate.t2),
    Column('t3', _time, 's', lambda item: item.estimate.t3),
    Column('t4', _time, 's', lambda item: item.t4),
    Column('belt_speed_m_per_s', _number, 'm/s', lambda item: item.estimate.belt_speed),
    Column('mass_g', _number, 'g', lambda item: GRAMS * item.estimate.mass, 9),
    Column('std_dev_g', _number, 'g', lambda item: GRAMS * item.estimate.std_dev, 9),
    Column('decision', ColumnType.TEXT, '', lambda item: item.verdict.decision.name),
    Column('reasons', ColumnType.TEXTS, '', lambda item: item.verdict.reasons),
    Column('reference_g', _number, 'g', lambda item: GRAMS * item.reference),
    Column('estimator', ColumnType.TEXT, '', lambda item: item.estimate.estimator),
    Column('zero_g', _number, 'g', lambda item: GRAMS * item.estimate.zero),
    Column('product_length_m', _number, 'm', lambda item: item.estimate.product_length),
    Column('a1', _number, '1', lambda item: item.estimate.a1, 9),
    Column('a2', _number, '1', lambda item: item.estimate.a2, 9),
    Column('b1_g', _number, 'g', lambda item: GRAMS * item.estimate.b1, 9),
    Column('natural_frequency_hz', _number, 'Hz', lambda item: item.estimate.natural_frequency),
    Column('damping_ratio', _number, '1', lambda item: item.estimate.damping_ratio),
    Column('lower_limit_g', _number, 'g', lambda item: GRAMS * item.verdict.lower_limit),
    Column('upper_limit_g', _number, 'g', lambda item: GRAMS * item.verdict.upper_limit),
    Column('reject_at', _time, 's', lambda item: item.verdict.reject_at),
)


def items_as_csv(results: Iterable[ItemResult]) -> Iterator[str]:
    """Yield the lines of a CSV file with a header and a row for each item."""
    names = [[column.name for column in COLUMNS]]
    return rows_as_csv(chain(names, ([each.text(item) for each in COLUMNS] for item in results)))


def rows_as_csv(rows: Iterable[Iterable[object]]) -> Iterator[str]:
    """Yield rows as lines of CSV.

    A text that a spreadsheet would evaluate as a formula, for example because it begins with =, is
    prefixed with an apostrophe.
    """
    # Return the line from `write`, because `writerow` returns the result of `write`.
    file: Any = SimpleNamespace(write=str)
    writer = csv.writer(file, lineterminator='\n')
    for row in rows:
        yield writer.writerow([f"'{each}" if _FORMULA.match(str(each)) else each for each in row])
