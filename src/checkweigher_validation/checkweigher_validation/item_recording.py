# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Extraction of one item of a recording into a shorter recording that gives the same result."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from checkweigher_core.recording import BlockColumns, Recording
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, MassEstimate, Verdict
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.results import ItemResult, weigh

# Largest difference between the masses of the item in the short and in the long recording, in
# standard deviations of the mass. The masses differ because the zero depends on all earlier
# samples.
_SAME_MASS = 0.1
_FEWEST = 2  # smallest number of preceding items, from which belt speed and zero are computed.
# Duration in ns of the signal that is kept after the item, per preceding item.
_AFTER = NANOSECONDS


class KeepError(ValueError):
    """Raised if an item cannot be cut out. The message contains the reason and advice."""


def keep_item(
    recording: Recording, parameters: LineParameters, estimate: MassEstimate, verdict: Verdict
) -> tuple[Recording, ItemResult]:
    """Return a short recording of an item and some preceding items, and the result of the item.

    The result depends on preceding items, because zero, belt speed and lag of the photo-eyes are
    computed from them. The number of preceding items is therefore doubled until the item has the
    same t1, t2, t3, decision and reasons as in `estimate` and `verdict`. The mass may differ by at
    most a tenth of its standard deviation. In the short recording, the numbers of the items begin
    with 1. `estimate` and `verdict` are the result of the item with `parameters`. At least one of
    t1, t2 and t3 must be known, and the recording must contain a sample block.

    Raises `KeepError` if the item has another result even in the whole recording.
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
                f'item {estimate.item_id} has another result even in the whole recording; use the '
                'parameters with which it was weighed'
            )
        count *= 2


def cut(recording: Recording, begin: int, end: int) -> Recording:
    """Return the part of a recording from `begin` to `end`, in ns.

    The part has at least one sample block. The blocks are not divided, so the signal may begin
    before `begin` and end after `end`.
    """
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
    """Return the times in ns midway between the exit of an item and the entry of the next item.

    Edges after `until` in ns are ignored.
    """
    return [
        (before.stamp + edge.stamp) // 2
        for before, edge in pairwise([edge for edge in edges if edge.stamp <= until])
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
