# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results of items with their references: the table and the summary."""

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
import math

from checkweigher_core.printable import counted, one_line
from checkweigher_core.recording import Recording
from checkweigher_core.records import (
    GRAMS,
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    MassEstimate,
    Reference,
    Verdict,
)
from checkweigher_dsp.pipeline.line import LineParameters, Weighing, WeighingLine
from checkweigher_dsp.signal.running_moments import RunningMoments
from checkweigher_recording.block_cutting import join_recording, join_stretches
from checkweigher_recording.progress import with_progress
from checkweigher_validation.accuracy.passes import SAME_ITEM, ReferenceMasses


@dataclass(frozen=True, slots=True)
class ItemResult:
    """Estimate, verdict and reference of one item."""

    estimate: MassEstimate
    verdict: Verdict
    t4: int | None = None  # ns
    reference: float = math.nan  # kg

    @property
    def error(self) -> float:
        """Mass less reference in kg; NaN if one of them is not known."""
        return self.estimate.mass - self.reference


class ResultJoiner:
    """Lookup of t4 and of the known mass of each weighing, from the edges and references of a bag.

    A weighing has no t4 of its own because the verdict is due before t4.
    """

    def __init__(self, edges: Iterable[EyeEdge], references: Iterable[Reference]) -> None:
        self._outfeed: list[tuple[int, bool]] = []
        self._references = ReferenceMasses(())
        self.extend(edges, references)

    def extend(self, edges: Iterable[EyeEdge], references: Iterable[Reference]) -> None:
        """Add edges and known masses."""
        self._outfeed += ((e.stamp, e.blocked) for e in edges if e.eye == Eye.OUTFEED)
        self._outfeed.sort()
        self._references.extend(references)

    def forget(self, t1: int) -> None:
        """Remove edges and known masses of items that entered before `t1`, ns."""
        del self._outfeed[: bisect_left(self._outfeed, (t1, False))]
        self._references.forget(t1)

    def join(self, estimate: MassEstimate, verdict: Verdict) -> ItemResult:
        """Return the result of one item."""
        reference = self._references.at(estimate.t1)
        return ItemResult(estimate, verdict, self._t4(estimate.t3), reference)

    def knows_t4(self, t3: int | None) -> bool:
        """Return whether t4 is known: an edge after t3 has arrived, or there is no t3."""
        return t3 is None or bisect_right(self._outfeed, (t3, True)) < len(self._outfeed)

    def _t4(self, t3: int | None) -> int | None:
        """Return the time of the edge after t3 if the outfeed eye clears with it."""
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

    With `progress` a bar is shown on a terminal if it takes more than a second.
    """
    line = WeighingLine(recording.load_cell, parameters)
    # Longer blocks are less work; the length of the blocks changes no mass.
    signal = join_recording(recording)
    events = with_progress(signal, 'weighing', len(signal), shown=progress)
    joiner = ResultJoiner(recording.edges, recording.references)
    results = [joiner.join(each.estimate, each.verdict) for each in line.weigh_all(events)]
    return sorted(results, key=lambda result: result.estimate.item_id)


def weigh_stretches(
    stretches: Iterable[Recording], parameters: LineParameters
) -> Iterator[ItemResult]:
    """Weigh a recording that comes in stretches, in memory that does not grow with its length.

    Yields the results that `weigh` returns for the whole recording, in the same order. There must
    be at least one stretch; see `checkweigher_recording.bags.reading.read_stretches`.
    """
    stretches = iter(stretches)
    first = next(stretches)
    line = WeighingLine(first.load_cell, parameters)
    waiting = _WaitingResults()
    known = map(waiting.know, chain([first], stretches))
    for weighing in line.weigh_all(join_stretches(known)):
        waiting.add(weighing)
        yield from waiting.complete()
    yield from waiting.rest()


class _WaitingResults:
    """Weighings that wait for edges and references of their items, and for earlier items."""

    def __init__(self) -> None:
        self._joiner = ResultJoiner((), ())
        self._waiting: list[Weighing] = []  # by item, then in order of arrival
        self._next = 1  # number of the next item
        self._known = -1  # ns; everything before this time has arrived

    def know(self, stretch: Recording) -> Recording:
        """Add edges and known masses of the next stretch, and return the stretch."""
        self._joiner.extend(stretch.edges, stretch.references)
        if len(stretch.blocks):
            self._known = stretch.blocks[-1].stamp
        return stretch

    def add(self, weighing: Weighing) -> None:
        """Add the next weighing."""
        insort(self._waiting, weighing, key=lambda each: each.estimate.item_id)

    def complete(self) -> Iterator[ItemResult]:
        """Yield the results of the next items for which nothing more will arrive."""
        while self._waiting and self._waiting[0].estimate.item_id <= self._next:
            estimate = self._waiting[0].estimate
            is_known = estimate.t1 is None or estimate.t1 + SAME_ITEM < self._known
            if not (is_known and self._joiner.knows_t4(estimate.t3)):
                return
            self._next = estimate.item_id + 1
            yield self._joiner.join(estimate, self._waiting.pop(0).verdict)
            if estimate.t1 is not None:
                self._joiner.forget(estimate.t1)

    def rest(self) -> Iterator[ItemResult]:
        """Yield the results of all remaining items, at the end of the recording."""
        for weighing in self._waiting:
            yield self._joiner.join(weighing.estimate, weighing.verdict)


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


class ErrorSum(RunningMoments):
    """Number, mean, standard deviation and largest magnitude of errors that are not kept."""

    def __init__(self) -> None:
        super().__init__()
        self.largest = 0.0

    def add(self, error: float) -> None:
        """Add an error."""
        super().add(error)
        if abs(error) > abs(self.largest):
            self.largest = error


def summary(decisions: Mapping[Decision, int], errors: ErrorSum) -> str:
    """Return one line with the number of items of each decision, and the errors in g."""
    count = sum(decisions.values())
    parts = [counted(count, 'item')]
    parts += [f'{decisions[each]} {each.name}' for each in Decision if each in decisions]
    if errors.count:
        parts.append(f'mean error {errors.mean:+.3f} g')
    if errors.count > 1:
        parts.append(f'standard deviation {errors.std_dev:.3f} g')
    if errors.count:
        parts.append(f'largest error {errors.largest:+.3f} g')
    return ', '.join(parts)
