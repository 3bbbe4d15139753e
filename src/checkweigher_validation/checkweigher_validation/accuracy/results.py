# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weighing of recordings, and a table of the results with a summary."""

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
import math

from checkweigher_core.block_cutting import join_recording, join_stretches
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
from checkweigher_dsp.signal.averages import RunningMoments
from checkweigher_recording.progress import with_progress
from checkweigher_validation.accuracy.passes import SAME_ITEM, ReferenceMasses


@dataclass(frozen=True, slots=True)
class ItemResult:
    """Estimate, verdict and known mass of one item."""

    estimate: MassEstimate
    verdict: Verdict
    t4: int | None = None  # time in ns at which the item has left the belt, None if unknown
    reference: float = math.nan  # known mass in kg, NaN if there is none

    @property
    def error(self) -> float:
        """Estimated mass minus known mass in kg, or NaN if one of them is unknown."""
        return self.estimate.mass - self.reference


class ResultJoiner:
    """Table of edges and known masses, which supplies t4 and the known mass of each item.

    A `Weighing` has no t4, because the verdict must be made before t4.
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
        """Remove edges before `t1` in ns, and known masses of items that entered before `t1`."""
        del self._outfeed[: bisect_left(self._outfeed, (t1, False))]
        self._references.forget(t1)

    def join(self, weighing: Weighing) -> ItemResult:
        """Return the result of an item with its t4 and known mass."""
        estimate = weighing.estimate
        reference = self._references.at(estimate.t1)
        return ItemResult(estimate, weighing.verdict, self._t4(estimate.t3), reference)

    def is_complete(self, estimate: MassEstimate, known: int) -> bool:
        """Return whether t4 and the known mass of an item are final.

        The caller must have added all events with a time before `known` in ns.
        """
        return (estimate.t1 is None or estimate.t1 + SAME_ITEM < known) and (
            estimate.t3 is None
            or bisect_right(self._outfeed, (estimate.t3, True)) < len(self._outfeed)
        )

    def _t4(self, t3: int | None) -> int | None:
        """Return the time in ns at which the outfeed eye clears after `t3`.

        Returns None if `t3` is None, if the outfeed eye has no edge after `t3`, or if an item
        begins to block the outfeed eye at the next edge.
        """
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
    """Weigh all items in a recording, and return the results in order of entry.

    If `progress` is True, a progress bar is shown on a terminal.
    """
    line = WeighingLine(recording.load_cell, parameters)
    # Join the sample blocks, because a few long blocks are processed faster than many short ones.
    # The division into blocks does not affect the masses.
    signal = join_recording(recording)
    events = with_progress(signal, 'weighing', len(signal), shown=progress)
    joiner = ResultJoiner(recording.edges, recording.references)
    results = map(joiner.join, line.weigh_all(events))
    return sorted(results, key=lambda result: result.estimate.item_id)


def weigh_stretches(
    stretches: Iterable[Recording], parameters: LineParameters
) -> Iterator[ItemResult]:
    """Yield the results that `weigh` returns for a recording, but in limited memory.

    `stretches` are the consecutive parts of the recording, at least one. The function
    `checkweigher_recording.bags.reading.read_stretches` yields such parts.
    """
    stretches = iter(stretches)
    first = next(stretches)
    joiner = ResultJoiner((), ())
    waiting: list[Weighing] = []  # weighings without a final result, sorted by item number.
    # Time in ns up to which all events are known, and number of the next item.
    known, following = -1, 1

    def arriving() -> Iterator[Recording]:
        nonlocal known
        for stretch in chain([first], stretches):
            joiner.extend(stretch.edges, stretch.references)
            if len(stretch.blocks):
                known = stretch.blocks[-1].stamp
            yield stretch

    line = WeighingLine(first.load_cell, parameters)
    for weighing in line.weigh_all(join_stretches(arriving())):
        insort(waiting, weighing, key=lambda each: each.estimate.item_id)
        while waiting and waiting[0].estimate.item_id <= following:
            estimate = waiting[0].estimate
            if not joiner.is_complete(estimate, known):
                break
            following = estimate.item_id + 1
            yield joiner.join(waiting.pop(0))
            if estimate.t1 is not None:
                joiner.forget(estimate.t1)
    yield from map(joiner.join, waiting)


TABLE_HEADER = (
    f'{"item":>6} {"t1 s":>9} {"m/min":>6} {"mass g":>10} {"+- g":>7} {"reference":>10} '
    f'{"error g":>8}  verdict'
)


def table_row(result: ItemResult, origin: int) -> str:
    """Return the row of a result in the text table with the header `TABLE_HEADER`.

    The table shows t1 in s after `origin`, which is a time in ns.
    """
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


def summary(decisions: Mapping[Decision, int], errors: RunningMoments) -> str:
    """Return a line with the number of items for each decision, and statistics of errors in g."""
    parts = [counted(sum(decisions.values()), 'item')]
    parts += [f'{decisions[each]} {each.name}' for each in Decision if each in decisions]
    if errors.count:
        parts.append(f'mean error {errors.mean:+.3f} g')
    if errors.count > 1:
        parts.append(f'standard deviation {errors.std_dev:.3f} g')
    if errors.count:
        parts.append(f'largest error {errors.largest:+.3f} g')
    return ', '.join(parts)
