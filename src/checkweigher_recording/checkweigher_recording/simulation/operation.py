# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Changes of the products, belt and photo-eyes of a simulated machine by an operator."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

from checkweigher_core.parameters import Parameters, parameter
from checkweigher_core.records import Eye
from checkweigher_recording.simulation.belt_travel import Pass

CAPACITY = 7.2  # capacity of the load cell in kg
_HEAVIEST = 2 * CAPACITY
_FLICKERS = 6  # number of additional switches of a dirty eye at each edge
_FLICKER = 0.002  # time in s between two switches of a dirty eye


def _place(eye: str) -> Any:
    text = f'displacement of the {eye} eye along the belt'
    return parameter(0.0, text, unit='m', minimum=-0.1, maximum=0.1)


def _is_dirty(eye: str) -> Any:
    text = f'whether the {eye} eye is dirty, so that it switches {1 + _FLICKERS} times at each edge'
    return parameter(False, text)


def _is_dead(eye: str) -> Any:
    return parameter(False, f'whether the {eye} eye is dead, so that it never switches')


@dataclass(frozen=True)
class OperationParameters(Parameters):
    """Parameters of a simulated machine that an operator may change while it runs."""

    node: ClassVar[str] = 'simulator.now'

    feed: bool = parameter(True, 'whether products enter the belt')
    speed: float = parameter(
        0.0, 'belt speed; 0 selects simulator.speed', unit='m/s', minimum=0.0, maximum=5.0
    )
    mass: float = parameter(
        0.0, 'product mass; 0 selects simulator.masses', unit='kg', minimum=0.0, maximum=_HEAVIEST
    )
    gap: float = parameter(
        0.0,
        'length of free belt between two products; 0 selects simulator.spacing',
        unit='m',
        minimum=0.0,
        maximum=10.0,
    )
    load: float = parameter(
        0.0, 'mass that rests on the belt', unit='kg', minimum=0.0, maximum=_HEAVIEST
    )
    zero: float = parameter(0.0, 'shift of the zero', unit='kg', minimum=-1.0, maximum=1.0)
    put: int = parameter(
        0,
        'number of products put on the infeed by hand so far; to put n more, increase it by n; '
        'they also enter without feed',
        minimum=0,
        maximum=1_000_000,
    )
    put_mass: float = parameter(
        0.0,
        'mass of a product put on the infeed by hand; 0 selects the mass of the other products',
        unit='kg',
        minimum=0.0,
        maximum=_HEAVIEST,
    )
    infeed_place: float = _place('infeed')
    infeed_dirty: bool = _is_dirty('infeed')
    infeed_dead: bool = _is_dead('infeed')
    outfeed_place: float = _place('outfeed')
    outfeed_dirty: bool = _is_dirty('outfeed')
    outfeed_dead: bool = _is_dead('outfeed')
    kill: bool = parameter(
        False, 'true kills the process of the driver, as the operating system would'
    )

    @property
    def lead(self) -> float:
        """Largest displacement of an eye against the belt direction in m, or 0 if there is none."""
        return max(0.0, -self.infeed_place, -self.outfeed_place)

    def switches(self, entry: Pass) -> Iterator[tuple[float, Eye, bool]]:
        """Yield time in s, eye, and whether the eye becomes blocked, for each switch of an eye.

        The product of the pass `entry` causes the switches. The switches are not sorted by time. A
        dead eye has no switches.
        """
        speed = entry.length / (entry.t2 - entry.t1)
        all_times = {Eye.INFEED: (entry.t1, entry.t2), Eye.OUTFEED: (entry.t3, entry.t4)}
        for eye, times in all_times.items():
            name = eye.name.lower()
            place, dirty, dead = (
                getattr(self, f'{name}_{state}') for state in ('place', 'dirty', 'dead')
            )
            for time, blocked in zip(times, (True, False), strict=True):
                for number in range(0 if dead else 1 + _FLICKERS * dirty):
                    late = place / speed if place else 0.0
                    yield time + late + number * _FLICKER, eye, blocked ^ (number % 2 == 1)


OPERATION = f'{OperationParameters.node}.'  # prefix of the names of the operation parameters
