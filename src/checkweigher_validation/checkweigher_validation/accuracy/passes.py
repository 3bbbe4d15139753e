"""Passes of products of known mass, by belt speed."""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.records import NANOSECONDS, LoadCell, Reference, WeighWindow
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter
from checkweigher_recording.recording import Event

# A reference belongs to the item whose t1 it carries; half a block of slack for foreign bags.
_SAME_ITEM = NANOSECONDS // 100
# Belt speeds that differ by less are one; a belt wanders by a few tenths of a percent.
_SAME_SPEED = 0.05


class ReferenceMasses:
    """Known masses by the time of entry.

    Parameters
    ----------
    references : iterable of Reference
        In any order.
    """

    def __init__(self, references: Iterable[Reference]) -> None:
        self._references = sorted(references, key=lambda reference: reference.stamp)
        self._stamps = [reference.stamp for reference in self._references]

    def at(self, t1: int | None) -> float:
        """Return the mass in kg of the item that entered at `t1` in ns, NaN if it is not known."""
        if t1 is None:
            return math.nan
        position = bisect_left(self._stamps, t1 - _SAME_ITEM)
        near = self._references[position : position + 2]
        best = min(near, key=lambda reference: abs(reference.stamp - t1), default=None)
        return best.mass if best and abs(best.stamp - t1) <= _SAME_ITEM else math.nan


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
    """All passes of one belt speed.

    Attributes
    ----------
    speed : float
        m/s; in a group of `group_by_speed` half way from the slowest pass to the fastest, so that
        none is further off than the identifier takes a pass for trained.
    passes : tuple of KnownPass
        In the order in which they ran.
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

    Parameters
    ----------
    load_cell : LoadCell
        Calibration, rate and the distance between the eyes.
    events : iterable of SampleBlock, EyeEdge and Reference
        In the order in which they came.
    parameters : SegmenterParameters
        How items are told apart.
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
    ordered = sorted(enumerate(whole), key=lambda item: item[1].window.belt_speed)
    groups: list[list[tuple[int, KnownPass]]] = []
    last = -math.inf
    for number, each in ordered:
        if each.window.belt_speed > last * (1 + _SAME_SPEED) or not groups:
            groups.append([])
            last = each.window.belt_speed
        groups[-1].append((number, each))
    return tuple(
        SpeedGroup(
            (group[0][1].window.belt_speed + group[-1][1].window.belt_speed) / 2,
            tuple(each for _, each in sorted(group, key=lambda item: item[0])),
        )
        for group in groups
    )


def spread(group: SpeedGroup, count: int) -> Sequence[KnownPass]:
    """Return `count` passes of a group at most, evenly over its masses and over time."""
    by_mass = sorted(range(len(group.passes)), key=lambda i: (group.passes[i].mass, i))
    chosen = np.unique(np.linspace(0, len(by_mass) - 1, min(count, len(by_mass))).round())
    return [group.passes[by_mass[int(position)]] for position in chosen]
