# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results of items, joined with their references: the table, the CSV and the summary."""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping
import csv
from dataclasses import dataclass
import math
from typing import TextIO

from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_dsp.printable import one_line
from checkweigher_dsp.records import (
    GRAMS,
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    MassEstimate,
    Reference,
    Verdict,
)
from checkweigher_recording.block_cutting import join_recording
from checkweigher_recording.progress import with_progress
from checkweigher_recording.recording import Recording
from checkweigher_validation.accuracy.passes import ReferenceMasses


@dataclass(frozen=True, slots=True)
class ItemResult:
    """One item with all that is known of it; ``reference`` in kg, NaN if there is none."""

    estimate: MassEstimate
    verdict: Verdict
    t4: int | None = None
    reference: float = math.nan

    @property
    def error(self) -> float:
        """Mass less reference in kg, NaN if either is not known."""
        return self.estimate.mass - self.reference


class ResultJoiner:
    """Join weighings with the known masses of a bag and with t4, from all photo-eye edges of it.

    A weighing itself has no t4, for the verdict is due before it.
    """

    def __init__(self, edges: Iterable[EyeEdge], references: Iterable[Reference]) -> None:
        self._outfeed = sorted((e.stamp, e.blocked) for e in edges if e.eye == Eye.OUTFEED)
        self._references = ReferenceMasses(references)

    def join(self, estimate: MassEstimate, verdict: Verdict) -> ItemResult:
        """Return the result of one item."""
        reference = self._references.at(estimate.t1)
        return ItemResult(estimate, verdict, self._t4(estimate.t3), reference)

    def _t4(self, t3: int | None) -> int | None:
        """Return the edge after t3, if the outfeed eye clears with it."""
        if t3 is None:
            return None
        position = bisect_right(self._outfeed, (t3, True))
        if position == len(self._outfeed):
            return None
        stamp, blocked = self._outfeed[position]
        return None if blocked else stamp


def weigh(
    recording: Recording, parameters: LineParameters, *, progress: bool = False
) -> list[ItemResult]:
    """Weigh everything in a recording, and return the results in order of entry.

    With `progress` there is a bar on a terminal if it takes more than a second.
    """
    line = WeighingLine(recording.load_cell, parameters)
    # As replay does at full speed: how a stream is cut changes no mass, and each block is work.
    signal = join_recording(recording)
    events = with_progress(signal, 'weighing', len(signal), shown=progress)
    joiner = ResultJoiner(recording.edges, recording.references)
    results = [joiner.join(each.estimate, each.verdict) for each in line.weigh_all(events)]
    return sorted(results, key=lambda result: result.estimate.item_id)


def write_csv(file: TextIO, results: Iterable[ItemResult]) -> None:
    """Write results as CSV: one row an item, empty where a value is not known."""
    writer = csv.writer(file, lineterminator='\n')
    writer.writerow(_COLUMNS)
    for result in results:
        writer.writerow([value(result) for value in _COLUMNS.values()])


def _time(stamp: int | None) -> str:
    """Format ns as seconds without rounding, which a float of today's date would."""
    if stamp is None:
        return ''
    whole, part = divmod(stamp, NANOSECONDS)
    return f'{whole}.{part:09d}'


def _number(value: float, digits: int = 6) -> str:
    return '' if math.isnan(value) else f'{value:.{digits}f}'


def _limit(value: float) -> str:
    return '' if math.isinf(value) else _number(GRAMS * value)


_COLUMNS: dict[str, Callable[[ItemResult], str]] = {
    'item_id': lambda item: str(item.estimate.item_id),
    't1': lambda item: _time(item.estimate.t1),
    't2': lambda item: _time(item.estimate.t2),
    't3': lambda item: _time(item.estimate.t3),
    't4': lambda item: _time(item.t4),
    'belt_speed_m_per_s': lambda item: _number(item.estimate.belt_speed),
    'mass_g': lambda item: _number(GRAMS * item.estimate.mass, 9),
    'std_dev_g': lambda item: _number(GRAMS * item.estimate.std_dev, 9),
    'decision': lambda item: item.verdict.decision.name,
    'reasons': lambda item: ';'.join(item.verdict.reasons),
    'reference_g': lambda item: _number(GRAMS * item.reference),
    'estimator': lambda item: item.estimate.estimator,
    'zero_g': lambda item: _number(GRAMS * item.estimate.zero),
    'product_length_m': lambda item: _number(item.estimate.product_length),
    'a1': lambda item: _number(item.estimate.a1, 9),
    'a2': lambda item: _number(item.estimate.a2, 9),
    'b1_g': lambda item: _number(GRAMS * item.estimate.b1, 9),
    'natural_frequency_hz': lambda item: _number(item.estimate.natural_frequency),
    'damping_ratio': lambda item: _number(item.estimate.damping_ratio),
    'lower_limit_g': lambda item: _limit(item.verdict.lower_limit),
    'upper_limit_g': lambda item: _limit(item.verdict.upper_limit),
    'reject_at': lambda item: _time(item.verdict.reject_at),
}

TABLE_HEADER = (
    f'{"item":>6} {"t1 s":>9} {"m/min":>6} {"mass g":>10} {"+- g":>7} {"reference":>10} '
    f'{"error g":>8}  verdict'
)


def table_row(result: ItemResult, origin: int) -> str:
    """Return one line for a screen; `origin` in ns is the zero of the column t1."""
    estimate, verdict = result.estimate, result.verdict
    t1 = '' if estimate.t1 is None else f'{(estimate.t1 - origin) / NANOSECONDS:.3f}'

    def cell(value: float, width: int, digits: int, sign: str = '') -> str:
        return f'{"-":>{width}}' if math.isnan(value) else f'{value:{sign}{width}.{digits}f}'

    return (
        f'{estimate.item_id:>6} {t1:>9} {cell(60 * estimate.belt_speed, 6, 1)} '
        f'{cell(GRAMS * estimate.mass, 10, 3)} {cell(GRAMS * estimate.std_dev, 7, 3)} '
        f'{cell(GRAMS * result.reference, 10, 3)} {cell(GRAMS * result.error, 8, 3, "+")}  '
        + one_line(' '.join((verdict.decision.name, *verdict.reasons)))
    )


class ErrorSum:
    """Number, mean, standard deviation and largest of errors, without keeping them."""

    def __init__(self) -> None:
        self.count = 0
        self.mean = self.largest = 0.0
        self._squares = 0.0  # of the distances from the mean

    def add(self, error: float) -> None:
        """Take a further error, by the update of Welford, Technometrics 4 (1962) 419."""
        self.count += 1
        before = error - self.mean
        self.mean += before / self.count
        self._squares += before * (error - self.mean)
        if abs(error) > abs(self.largest):
            self.largest = error

    @property
    def std_dev(self) -> float:
        """Standard deviation; NaN of fewer than two."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else math.nan


def summary(decisions: Mapping[Decision, int], errors: ErrorSum) -> str:
    """Return one line on all items: how many had each decision, and the errors in g."""
    count = sum(decisions.values())
    parts = [f'{count} item{"" if count == 1 else "s"}']
    parts += [f'{decisions[each]} {each.name}' for each in Decision if each in decisions]
    if errors.count:
        parts.append(f'mean error {errors.mean:+.3f} g')
    if errors.count > 1:
        parts.append(f'standard deviation {errors.std_dev:.3f} g')
    if errors.count:
        parts.append(f'largest error {errors.largest:+.3f} g')
    return ', '.join(parts)
