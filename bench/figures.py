# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Measured figures with their references, as a table and as a file."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
import json
import math
import os
from pathlib import Path
import platform
import statistics
from typing import Any


@dataclass(frozen=True, slots=True)
class Figure:
    """Something that was measured.

    Attributes
    ----------
    median, low, high, worst : float
        Of the values: median, quartiles, and what 99.9 % do not exceed.
    reference : float
        What it is compared with, in the same unit; NaN if there is nothing.
    target : float
        What the median is to be at most, or at least where `more_is_better`; NaN if any will do.
    reference_there : float
        What the reference was on the machine for which the target was set; NaN if not known.
    """

    name: str
    unit: str
    count: int
    median: float
    low: float
    high: float
    worst: float
    reference: float = math.nan
    target: float = math.nan
    reference_there: float = math.nan
    more_is_better: bool = False

    @property
    def target_here(self) -> float:
        """The target for a machine that is as much slower as its reference is, NaN if not known."""
        return self.target * self.reference / self.reference_there

    @property
    def verdict(self) -> str:
        """Whether the target is met."""
        if math.isnan(self.target):
            return ''
        sign = -1 if self.more_is_better else 1
        if sign * self.median <= sign * self.target:
            return 'met'
        # A comparison with NaN is false.
        return 'met in proportion' if sign * self.median <= sign * self.target_here else 'MISSED'


def figure(name: str, unit: str, values: list[float], **more: Any) -> Figure:
    """Return a figure of values."""
    ordered = sorted(values)
    low, median, high = statistics.quantiles(ordered, n=4) if len(ordered) > 1 else [ordered[0]] * 3
    worst = ordered[min(len(ordered) - 1, math.floor(0.999 * len(ordered)))]
    return Figure(name, unit, len(ordered), median, low, high, worst, **more)


def table(figures: list[Figure]) -> str:
    """Return the figures as lines of text."""
    rows = [
        (
            'figure',
            'median',
            'middle half',
            '99.9 %',
            'unit',
            'reference',
            'ratio',
            'target',
            'here',
            '',
        )
    ]
    for each in figures:
        known = not math.isnan(each.reference)
        rows.append(
            (
                each.name,
                f'{each.median:.3g}',
                f'{each.low:.3g}-{each.high:.3g}',
                f'{each.worst:.3g}',
                each.unit,
                f'{each.reference:.3g}' if known else '',
                f'{each.median / each.reference:.3g}' if known else '',
                _shown(each.target),
                _shown(each.target_here),
                each.verdict,
            )
        )
    return aligned(rows, left=(0, 4, 9))


def aligned(rows: Sequence[Sequence[str]], left: Collection[int]) -> str:
    """Return rows as lines of text, with some columns aligned to the left, the others right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return '\n'.join(
        '  '.join(
            cell.ljust(width) if at in left else cell.rjust(width)
            for at, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )


def write_json(path: Path, **found: object) -> None:
    """Write what was found, and on which machine, to a file."""
    machine = {
        'machine': platform.machine(),
        'python': platform.python_version(),
        'cores': len(os.sched_getaffinity(0)),
    }
    path.write_text(json.dumps({**machine, **found}, indent=1) + '\n', encoding='utf-8')


def _shown(value: float) -> str:
    return '' if math.isnan(value) else f'{value:.3g}'
