# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Passes of products of known mass, by belt speed."""

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

# A reference belongs to the item whose t1 it carries; half a block of slack for foreign bags.
SAME_ITEM = NANOSECONDS // 100
# Belt speeds that differ by less are one; a belt wanders by a few tenths of a percent.
_SAME_SPEED = 0.05


class ReferenceMasses:
    """Known masses by the time of entry, from references in any order."""

    def __init__(self, references: Iterable[Reference]) -> None:
        self._references = sorted(references, key=lambda reference: reference.stamp)

    def extend(self, references: Iterable[Reference]) -> None:
        """Take further references, in any order."""
        self._references += references
        self._references.sort(key=lambda reference: reference.stamp)

    def forget(self, t1: int) -> None:
        """Forget what belongs to items that entered before `t1`, ns."""
        first = bisect_left(self._references, t1 - SAME_ITEM, key=lambda known: known.stamp)
        del self._references[:first]

    def at(self, t1: int | None) -> float:
        """Return the mass in kg of the item that entered at `t1` in ns, NaN if it is not known."""
        if t1 is None:
            return math.nan
        first = bisect_left(self._references, t1 - SAME_ITEM, key=lambda known: known.stamp)
        near = self._references[first : first + 2]
        best = min(near, key=lambda reference: abs(reference.stamp - t1), default=None)
        return best.mass if best and abs(best.stamp - t1) <= SAME_ITEM else math.nan


@dataclass(frozen=True, slots=True)
class KnownPass:
    """A window, or the fault that it became, and the true mass of its product in kg."""

    window: WeighWindow
    mass: float

    @property
    def whole(self) -> bool:
        """Whether it can be weighed."""
        return not self.window.reasons


@dataclass(frozen=True, slots=True)
class SpeedGroup:
    """All passes of one belt speed in m/s, in the order in which they ran.

    The speed of a group of `group_by_speed` is half way from the slowest pass to the fastest, so
    that none is further off than the identifier takes a pass for trained.
    """

    speed: float
    passes: tuple[KnownPass, ...]

    @property
    def masses(self) -> NDArray[np.float64]:
        """True masses, (n,) float64, kg."""
        return np.array([each.mass for each in self.passes])


def known_passes(
    load_cell: LoadCell, events: Iterable[Event], parameters: SegmenterParameters
) -> list[KnownPass]:
    """Return the passes of known mass of a recording or simulation, in order of entry.

    The events are blocks of samples, edges and references in the order in which they came.
    """
    segmenter = Segmenter(load_cell, parameters)
    windows: list[WeighWindow] = []
    references: list[Reference] = []
    for event in events:
        if isinstance(event, Reference):
            references.append(event)
        else:
            windows += segmenter.take(event)
    windows += segmenter.finish()
    masses = ReferenceMasses(references)
    known = [KnownPass(window, masses.at(window.t1)) for window in windows]
    return sorted(
        (each for each in known if 0 < each.mass < math.inf), key=lambda each: each.window.item_id
    )


def group_by_speed(passes: Iterable[KnownPass]) -> tuple[SpeedGroup, ...]:
    """Return the whole passes by belt speed, slowest first."""
    whole = [each for each in passes if each.whole]
    groups: list[list[int]] = []
    slowest = -math.inf
    for number in sorted(range(len(whole)), key=lambda number: whole[number].window.belt_speed):
        speed = whole[number].window.belt_speed
        if speed > slowest * (1 + _SAME_SPEED) or not groups:
            groups.append([])
            slowest = speed
        groups[-1].append(number)
    return tuple(
        SpeedGroup(
            (whole[group[0]].window.belt_speed + whole[group[-1]].window.belt_speed) / 2,
            tuple(whole[number] for number in sorted(group)),
        )
        for group in groups
    )


def spread(group: SpeedGroup, count: int) -> Sequence[KnownPass]:
    """Return `count` passes of a group at most, evenly over its masses and over time."""
    by_mass = sorted(range(len(group.passes)), key=lambda i: (group.passes[i].mass, i))
    chosen = np.unique(np.linspace(0, len(by_mass) - 1, min(count, len(by_mass))).round())
    return [group.passes[by_mass[int(position)]] for position in chosen]
