# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Masses and belt speeds of the recorded passes, and the loads that these passes do not cover."""

import asyncio
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
import math
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import NANOSECONDS, Eye
from checkweigher_core.ros import ports
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.results import read_records
from checkweigher_validation.verification.plan import MINUTE, read_plan
from checkweigher_validation.verification.steps import StepKind, steps_of
from checkweigher_web.languages.language import Mass, Text
from checkweigher_web.work.services import LaneServices

# A mass is covered up to `_HEAVIER` times the heaviest recorded mass, and down to the lightest
# recorded mass divided by `_LIGHTER`. On simulated machines, the estimator `learned`, trained on
# 150 g alone, has mean errors of at most 0.06 g from 50 to 225 g, but up to 0.12 g at 300 g and
# 0.42 g at 500 g.
_HEAVIER, _LIGHTER = 1.5, 3.0
SAME_SPEED = 0.03  # largest relative difference between speeds that count as equal
_MANY = 1000  # maximum number of bags whose passes are cached

_REASON = Text(
    'Record passes of these masses at these speeds, too, and then train. A heavier product swings '
    'more slowly on the belt, which passes of a lighter one do not show. Outside the trained '
    'speeds nothing is weighed.'
)
Load = tuple[float, float]  # belt speed in m/s and mass in kg


class Recorded(NamedTuple):
    """Recorded passes of one mass at one belt speed."""

    speed: float  # median belt speed in m/s
    mass: float  # kg
    passes: int
    spacing: float  # median distance in m from one product to the next, NaN for a single pass


async def recorded(services: LaneServices) -> tuple[Recorded, ...]:
    """Return the passes that a lane has recorded for its training, in the order of recording.

    Returns () if no message on the dynamic setting has arrived.
    """
    said = services.setting
    return () if said is None else await asyncio.to_thread(passes_in, said.bags)


def passes_in(bags: Iterable[str]) -> tuple[Recorded, ...]:
    """Return the passes in bags, in the order of the bags. A bag that cannot be read is skipped."""
    found: list[Recorded | None] = []
    for bag in map(Path, bags):
        with suppress(OSError):
            found.append(_recorded(bag, bag.stat().st_mtime_ns))
    return tuple(filter(None, found))


@lru_cache(_MANY)
def _recorded(bag: Path, changed: int) -> Recorded | None:
    """Return the passes in a bag. All passes in a bag have the same mass.

    Returns None if the bag is damaged, lacks the data of the load cell, or has no edge of the
    outfeed eye after a reference mass. `changed` is the time of the last change of the bag in ns.
    The result is cached until the bag changes, even if the bag is damaged.
    """
    topics = ports.LOAD_CELL_INFO, ports.PHOTO_EYES, ports.REFERENCE_MASS
    try:
        cells, edges, references = read_records(bag, *topics).values()
    except BagError:
        return None
    times = np.array([each.stamp for each in references])
    exits = np.sort([each.stamp for each in edges if each.eye is Eye.OUTFEED and each.blocked])
    after = np.searchsorted(exits, times)
    known = after < len(exits)
    if not (cells and known.any()):
        return None
    transit = np.median(exits[after[known]] - times[known]) / NANOSECONDS
    speed = cells[0].weigh_length / float(transit)
    interval = float(np.median(np.diff(times))) / NANOSECONDS if len(times) > 1 else math.nan
    return Recorded(speed, references[0].mass, len(times), speed * interval)


def usual_spacing(known: Iterable[Recorded]) -> float:
    """Return the median of the spacings in m of recordings, or NaN if no spacing is known.

    Each recording has the same weight, however many passes it has.
    """
    spacings = [each.spacing for each in known if math.isfinite(each.spacing)]
    return median(spacings) if spacings else math.nan


def loads_of(plan: str) -> list[Load]:
    """Return the speed in m/s and the mass in kg for each step in which a load passes the belt.

    `plan` is the text of a verification plan. Steps outside the range of dynamic setting are left
    out, because their passes must be faults. Returns [] if the plan is not valid.
    """
    try:
        steps = steps_of(read_plan(plan))
    except ParameterError:
        return []
    return [
        (step.speed, step.load.mass)
        for step in steps
        if step.load and step.speed and step.kind is not StepKind.OUTSIDE
    ]


def not_covered(known: Sequence[Recorded], loads: Iterable[Load]) -> Iterator[Load]:
    """Yield the lightest and the heaviest load at each speed, unless the load is covered.

    A load is covered if recorded passes cover both its speed and its mass. A speed is covered
    between the lowest and the highest recorded speed, where training interpolates, and up to 3 %
    outside this range. A mass is covered if it is at most 1.5 times the heaviest recorded mass at
    the nearest recorded speed, and at least a third of the lightest recorded mass at that speed.
    Without recorded passes, no load is covered.
    """
    masses: dict[float, set[float]] = {}
    for speed, mass in loads:
        masses.setdefault(speed, set()).add(mass)
    for speed, own in sorted(masses.items()):
        for mass in sorted({min(own), max(own)}):
            if not _is_covered(known, speed, mass):
                yield speed, mass


def _is_covered(known: Sequence[Recorded], speed: float, mass: float) -> bool:
    speeds = [each.speed for each in known]
    low, high = 1 - SAME_SPEED, 1 + SAME_SPEED
    if not (speeds and low * min(speeds) <= speed <= high * max(speeds)):
        return False
    nearest = min(speeds, key=lambda each: abs(each - speed))
    masses = [each.mass for each in known if low <= each.speed / nearest <= high]
    return min(masses) / _LIGHTER <= mass <= max(masses) * _HEAVIER


def lines_of(lacking: Iterable[Load]) -> list[Text]:
    """Return a line for each load in `lacking`, and a line of advice.

    `lacking` contains the loads that the recorded passes do not cover. Returns [] if `lacking` is
    empty.
    """
    lines = [
        Text(
            'Asked for by the plan of Verify, but not covered by the recorded passes: {mass} at '
            '{speed} m/min',
            mass=Mass(round(mass, 6)),
            speed=round(MINUTE * speed),
        )
        for speed, mass in lacking
    ]
    return [*lines, _REASON] if lines else []
