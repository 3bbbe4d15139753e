# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small recording of one item, cut from a long one so that the item is weighed as in that."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from checkweigher_core.recording import BlockColumns, Recording
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, MassEstimate, Verdict
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.results import ItemResult, weigh

# Of its standard deviation, by which the mass may be another one: the zero is an average over all
# that was before.
_SAME_MASS = 0.1
_FEWEST = 2  # items before it, where there are so many: speed and zero are known from them
_AFTER = NANOSECONDS  # for each of them, of what comes after the item


class KeepError(ValueError):
    """An item that cannot be kept; one line that says why and what to do."""


def keep_item(
    recording: Recording, parameters: LineParameters, estimate: MassEstimate, verdict: Verdict
) -> tuple[Recording, ItemResult]:
    """Cut an item out, with as many items before it as its verdict needs.

    Zero, speed of the belt and lag of the eyes are learned from the items before. How many of them
    matter is seen by weighing: twice as many are tried until the verdict is the same.

    Parameters
    ----------
    recording : Recording
        What the item was weighed in.
    parameters : LineParameters
        Those that it was weighed with.
    estimate, verdict : MassEstimate, Verdict
        What became of it.

    Returns
    -------
    Recording
        The small one.
    ItemResult
        The item in it: the same decision and reasons, and a mass within a tenth of its standard
        deviation. Its number counts from 1 in the small recording.

    Raises
    ------
    KeepError
        If the item is weighed another way even in the whole recording.
    """
    stamps = [s for s in (estimate.t1, estimate.t2, estimate.t3) if s is not None]
    begins, first = _empty_moments(recording.edges, min(stamps)), recording.blocks[0].stamp
    count = _FEWEST
    while True:
        begin = begins[-count - 1] if count < len(begins) else first
        end = max(stamps) + count * _AFTER
        part = cut(recording, begin, end)
        for result in weigh(part, parameters):
            if _is_same(result, estimate, verdict):
                return part, result
        if begin == first and end > recording.blocks[-1].stamp:
            raise KeepError(
                f'item {estimate.item_id} is weighed another way in the whole recording; keep it '
                'with the parameters that it was weighed with'
            )
        count *= 2


def cut(recording: Recording, begin: int, end: int) -> Recording:
    """Return what a recording has from `begin` to `end`, ns, in whole blocks."""
    blocks = BlockColumns.of(recording.blocks)
    first = max(int(np.searchsorted(blocks.stamps, begin, 'right')) - 1, 0)
    last = max(int(np.searchsorted(blocks.stamps, end, 'right')), first + 1)
    return replace(
        recording,
        blocks=blocks.take(np.arange(first, last)),
        edges=tuple(edge for edge in recording.edges if begin <= edge.stamp <= end),
        references=tuple(each for each in recording.references if begin <= each.stamp <= end),
    )


def _empty_moments(edges: Sequence[EyeEdge], until: int) -> list[int]:
    """Return moments between an item that has left and the next one that enters, ns."""
    known = [edge for edge in edges if edge.stamp <= until]
    return [
        (before.stamp + edge.stamp) // 2
        for before, edge in pairwise(known)
        if (before.eye, before.blocked) == (Eye.OUTFEED, False)
        and (edge.eye, edge.blocked) == (Eye.INFEED, True)
    ]


def _is_same(result: ItemResult, estimate: MassEstimate, verdict: Verdict) -> bool:
    found, seen = result.estimate, result.verdict
    return (
        (found.t1, found.t2, found.t3) == (estimate.t1, estimate.t2, estimate.t3)
        and (seen.decision, seen.reasons) == (verdict.decision, verdict.reasons)
        and not abs(found.mass - estimate.mass) > _SAME_MASS * estimate.std_dev
    )
