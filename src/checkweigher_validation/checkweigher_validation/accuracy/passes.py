# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Passes of products of known mass."""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import Event
from checkweigher_core.records import NANOSECONDS, LoadCell, Reference, WeighWindow
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

# Largest difference in ns between the time of a reference and t1 of its item.
SAME_ITEM = NANOSECONDS // 100
_SAME_SPEED = 0.05  # largest relative difference between the belt speeds in a group


class ReferenceMasses:
    """Known masses of items by their time of entry."""

    def __init__(self, references: Iterable[Reference]) -> None:
        self._references: list[Reference] = []
        self.extend(references)

    def extend(self, references: Iterable[Reference]) -> None:
        """Add references, in any order."""
        self._references += references
        self._references.sort(key=lambda reference: reference.stamp)

    def forget(self, t1: int) -> None:
        """Remove the references of items that entered before `t1` in ns."""
        del self._references[: self._first(t1)]

    def at(self, t1: int | None) -> float:
        """Return the mass in kg of the item that entered at `t1` in ns, or NaN if unknown."""
        if t1 is None:
            return math.nan
        first = self._first(t1)
        near = self._references[first : first + 2]
        best = min(near, key=lambda reference: abs(reference.stamp - t1), default=None)
        return best.mass if best and abs(best.stamp - t1) <= SAME_ITEM else math.nan

    def _first(self, t1: int) -> int:
        """Return the position of the first reference of an item that entered at `t1` or later.

        References up to `SAME_ITEM` ns before `t1` also belong to an item that entered at `t1`.
        """
        return bisect_left(self._references, t1 - SAME_ITEM, key=lambda known: known.stamp)


@dataclass(frozen=True, slots=True)
class KnownPass:
    """Weighing window of a pass, perhaps with faults, and true mass of the product."""

    window: WeighWindow
    mass: float  # true mass in kg

    @property
    def whole(self) -> bool:
        """Whether the window has no faults, so that it can be weighed."""
        return not self.window.reasons


@dataclass(frozen=True, slots=True)
class SpeedGroup:
    """All passes of about the same belt speed that have no faults."""

    speed: float  # mean of the smallest and the largest belt speed in m/s
    passes: tuple[KnownPass, ...]  # in order of entry

    @property
    def masses(self) -> NDArray[np.float64]:
        """True masses, (n,), in kg."""
        return np.array([each.mass for each in self.passes])


def known_passes(
    load_cell: LoadCell, events: Iterable[Event], parameters: SegmenterParameters
) -> list[KnownPass]:
    """Return the passes of known mass in order of entry, including passes with faults.

    `events` are the sample blocks, edges and references of a recording or simulation. Passes whose
    reference is missing, not positive or not finite are left out.
    """
    (passes,) = passes_by_cut(load_cell, events, [parameters])
    return passes


def passes_by_cut(
    load_cell: LoadCell, events: Iterable[Event], cuts: Sequence[SegmenterParameters]
) -> list[list[KnownPass]]:
    """Return the passes that `known_passes` returns for each of the parameters `cuts`."""
    segmenters = [Segmenter(load_cell, parameters) for parameters in cuts]
    windows: list[list[WeighWindow]] = [[] for _ in cuts]
    references: list[Reference] = []
    for event in events:
        if isinstance(event, Reference):
            references.append(event)
            continue
        for segmenter, own in zip(segmenters, windows, strict=True):
            own += segmenter.take(event)
    masses = ReferenceMasses(references)
    found = []
    for segmenter, own in zip(segmenters, windows, strict=True):
        known = [KnownPass(each, masses.at(each.t1)) for each in (*own, *segmenter.finish())]
        found.append([each for each in known if 0 < each.mass < math.inf])
    return [sorted(each, key=lambda one: one.window.item_id) for each in found]


def whole_passes(passes: Iterable[KnownPass]) -> tuple[KnownPass, ...]:
    """Return the passes without faults."""
    return tuple(each for each in passes if each.whole)


def group_by_speed(passes: Iterable[KnownPass]) -> tuple[SpeedGroup, ...]:
    """Return the passes without faults in groups of about the same belt speed, slowest first.

    A belt speed exceeds the slowest belt speed of its group by at most 5 %.
    """
    whole = whole_passes(passes)
    speeds = np.array([each.window.belt_speed for each in whole])
    groups: list[SpeedGroup] = []
    left = np.argsort(speeds)
    while len(left):
        own = left[speeds[left] <= speeds[left[0]] * (1 + _SAME_SPEED)]
        middle = float(speeds[own[0]] + speeds[own[-1]]) / 2
        groups.append(SpeedGroup(middle, tuple(whole[number] for number in sorted(own))))
        left = left[len(own) :]
    return tuple(groups)


def evenly_chosen(group: SpeedGroup, count: int) -> Sequence[KnownPass]:
    """Return at most `count` passes of a group, evenly distributed over masses and time."""
    by_mass = sorted(range(len(group.passes)), key=lambda i: (group.passes[i].mass, i))
    chosen = np.unique(np.linspace(0, len(by_mass) - 1, min(count, len(by_mass))).round())
    return [group.passes[by_mass[int(position)]] for position in chosen]
