# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results of items, joined with their references: the table and the summary."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from heapq import heappop, heappush
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
        self._outfeed: list[tuple[int, bool]] = []
        self._references = ReferenceMasses(())
        self.extend(edges, references)

    def extend(self, edges: Iterable[EyeEdge], references: Iterable[Reference]) -> None:
        """Take further edges and known masses."""
        self._outfeed += ((e.stamp, e.blocked) for e in edges if e.eye == Eye.OUTFEED)
        self._outfeed.sort()
        self._references.extend(references)

    def forget(self, t1: int) -> None:
        """Forget what belongs to items that entered before `t1`, ns."""
        del self._outfeed[: bisect_left(self._outfeed, (t1, False))]
        self._references.forget(t1)

    def join(self, estimate: MassEstimate, verdict: Verdict) -> ItemResult:
        """Return the result of one item."""
        reference = self._references.at(estimate.t1)
        return ItemResult(estimate, verdict, self._t4(estimate.t3), reference)

    def knows_t4(self, t3: int | None) -> bool:
        """Tell whether there is an edge after t3, or none is to be waited for."""
        return t3 is None or bisect_right(self._outfeed, (t3, True)) < len(self._outfeed)

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


def weigh_stretches(
    stretches: Iterable[Recording], parameters: LineParameters
) -> Iterator[ItemResult]:
    """Weigh a recording that comes in stretches, in memory that does not grow with it.

    Yield the results that `weigh` returns of the whole, in the same order. At least one stretch is
    needed; see `checkweigher_recording.bags.reading.read_stretches`.
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
    """Weighings that wait for what the bag has of their items, and for the items before them."""

    def __init__(self) -> None:
        self._joiner = ResultJoiner((), ())
        # A heap, by item and order of coming.
        self._waiting: list[tuple[int, int, MassEstimate, Verdict]] = []
        self._came = 0
        self._next = 1  # item
        self._known = -1  # ns: all that is before has come

    def know(self, stretch: Recording) -> Recording:
        """Take edges and known masses of the next stretch, and return it."""
        self._joiner.extend(stretch.edges, stretch.references)
        if len(stretch.blocks):
            self._known = stretch.blocks[-1].stamp
        return stretch

    def add(self, weighing: Weighing) -> None:
        """Take the next weighing."""
        estimate, verdict = weighing.estimate, weighing.verdict
        heappush(self._waiting, (estimate.item_id, self._came, estimate, verdict))
        self._came += 1

    def complete(self) -> Iterator[ItemResult]:
        """Yield the results of the next items of which all is known."""
        while self._waiting and self._waiting[0][0] <= self._next:
            estimate = self._waiting[0][2]
            is_known = estimate.t1 is None or estimate.t1 + SAME_ITEM < self._known
            if not (is_known and self._joiner.knows_t4(estimate.t3)):
                return
            self._next = estimate.item_id + 1
            yield self._joined()
            if estimate.t1 is not None:
                self._joiner.forget(estimate.t1)

    def rest(self) -> Iterator[ItemResult]:
        """Yield the results of all items that are left: nothing more comes."""
        while self._waiting:
            yield self._joined()

    def _joined(self) -> ItemResult:
        *_, estimate, verdict = heappop(self._waiting)
        return self._joiner.join(estimate, verdict)


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
    """Number, mean, standard deviation and largest of errors, without keeping them."""

    def __init__(self) -> None:
        super().__init__()
        self.largest = 0.0

    def add(self, error: float) -> None:
        """Take a further error."""
        super().add(error)
        if abs(error) > abs(self.largest):
            self.largest = error


def summary(decisions: Mapping[Decision, int], errors: ErrorSum) -> str:
    """Return one line on all items: how many had each decision, and the errors in g."""
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
