# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Positions of the products on the belt of a simulated line."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from checkweigher_recording.simulation.machine import Variation
from checkweigher_recording.simulation.noise import Array

if TYPE_CHECKING:
    from checkweigher_recording.simulation.simulator import SimulationParameters

# Only the share of a product that is on the belt moves with the platform. It is kept constant over
# 1/16 of the crossing, so its error is at most 1/32 of the product.
_STAIRS = 16


STEADY = Variation(speed=0.0, length=0.0, spacing=0.0)


@dataclass(frozen=True, slots=True)
class Pass:
    """Passage of one product over the weigh belt."""

    mass: float  # kg
    t1: float  # s, begins to enter
    t2: float  # s, is fully on
    t3: float  # s, begins to leave
    t4: float  # s, is gone
    travel: float  # m, of the belt at t1
    impact: float  # standard normal number, sign and size of the impact at entry
    length: float  # m, of the product
    number: int  # from 0


class BeltTravel:
    """Travel of the belt over time, and the passes on it.

    Time only advances, and passes that are over are removed, so that an endless line needs no more
    memory than a short one. `passes` are the planned passes that are not over, in order of entry;
    `last_exit` is t4 of the last product in s, once it is planned.

    An operator may set `speed` in m/s, `feed` (whether products come), their `mass` in kg (0 for
    the masses of the line), and `resting`, the mass that rests on the belt, in kg. The settings
    apply from the next call of `plan` on.
    """

    def __init__(
        self,
        line: 'SimulationParameters',
        variation: Variation,
        random: np.random.Generator,
        products: np.random.Generator | None = None,
        next_mass: Callable[[], float] | None = None,
    ) -> None:
        """Begin a line with random speeds from `random`, and lengths and gaps from `products`.

        `variation` has their standard deviations; that of the gaps is limited, to keep the products
        apart. `next_mass` returns the mass of each product in kg, by default the masses of the line
        in turn.
        """
        self.passes: list[Pass] = []
        self.last_exit: float | None = None
        self.speed = line.speed
        self.feed = True
        self.mass = self.resting = 0.0
        self._line = line
        self._speed_jitter = variation.speed
        self._length_jitter = variation.length * line.product_length
        self._spacing_jitter = min(variation.spacing, (line.spacing - line.product_length) / 5)
        self._random = random
        self._products = random if products is None else products
        self._next_mass = next_mass or cycle(line.masses).__next__
        self._planned = 0
        self._next = 0.0  # m, travel at which the next product enters
        self._knots = 0
        self._impacts: deque[float] = deque()
        # Times and travels at which the speed changes: 1 s before the start, and at each entry.
        self._times = [-1.0, line.lead_in]
        self._travels = [-(line.lead_in + 1.0) * line.speed, 0.0]

    def plan(self, begin: float, end: float) -> list[Pass]:
        """Remove passes that are over at `begin`, and return new ones up to `end`, both in s."""
        self.passes = [entry for entry in self.passes if entry.t4 >= begin]
        while self._times[1] < begin:
            del self._times[0], self._travels[0]
        while self._times[-1] <= end:
            self._extend()
        added: list[Pass] = []
        while not self._complete() and self._time_of(self._next) <= end:
            entry = self._next_pass()
            if self.feed:
                added.append(entry)
        self.passes += added
        return added

    def travel(self, time: Array) -> Array:
        """Return the travel in m since the first entry, at times (n,) within the plan."""
        return np.interp(time, self._times, self._travels)

    def load(self, time: Array, travel: Array) -> Array:
        """Return the mass on the belt in kg at times and their travels, (n,) each."""
        load = np.full(len(time), self.resting)
        for entry, touched in self.touched(time):
            load[touched] += entry.mass * self.share(entry, travel[touched])
        return load

    def touched(self, time: Array) -> Iterator[tuple[Pass, slice]]:
        """Yield each pass with the slice of the times, (n,), at which it is on the belt."""
        for entry in self.passes:
            yield entry, slice(*np.searchsorted(time, (entry.t1, entry.t4)))

    def load_steps(self, time: Array, travel: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the mass that moves with the platform as a staircase.

        Returns the steps at which it changes, (m + 1,) from 0 to n, and the mass between them,
        (m,) in kg.
        """
        steps = [np.array((0, len(time)))]
        for entry in self.passes:
            for begin, end in ((entry.t1, entry.t2), (entry.t3, entry.t4)):
                steps.append(np.searchsorted(time, np.linspace(begin, end, _STAIRS + 1)))
        bounds = np.unique(np.concatenate(steps))
        middle = travel[(bounds[:-1] + bounds[1:]) // 2]
        mass = np.full(len(middle), self.resting)
        for entry in self.passes:
            share = self.share(entry, middle)
            stair = (np.floor(share * _STAIRS) + 0.5) / _STAIRS
            mass += entry.mass * np.where((share > 0) & (share < 1), stair, share)
        return bounds, mass

    def share(self, entry: Pass, travel: Array) -> Array:
        """Return the fraction of a product on the belt, in 0..1, at travels (n,) in m."""
        way = travel - entry.travel
        leaving = way - self._line.weigh_length
        return np.clip(way / entry.length, 0, 1) - np.clip(leaving / entry.length, 0, 1)

    def _complete(self) -> bool:
        return self._line.count > 0 and self._planned >= self._line.count

    def _next_pass(self) -> Pass:
        line = self._line
        entry, length, weigh_length = self._next, line.product_length, line.weigh_length
        number = self._planned
        self._next = (number + 1) * line.spacing
        if self._spacing_jitter or self._length_jitter:
            gap, longer = np.clip(self._products.standard_normal(2), -2.0, 2.0).tolist()
            length += self._length_jitter * longer
            self._next += self._spacing_jitter * gap
        while self._travels[-1] < entry + weigh_length + length:
            self._extend()
        ways = (0.0, length, weigh_length, weigh_length + length)
        t1, t2, t3, t4 = (self._time_of(entry + way) for way in ways)
        mass = self._next_mass()  # drawn even if the operator has set a mass
        self._planned += 1
        if self._complete():
            self.last_exit = t4
        return Pass(
            self.mass or mass, t1, t2, t3, t4, entry, self._impacts.popleft(), length, number
        )

    def _extend(self) -> None:
        jitter, impact = self._random.standard_normal(2)
        self._impacts.append(float(impact))
        speed = self.speed * (1 + self._speed_jitter * float(jitter))
        self._times.append(self._times[-1] + self._line.spacing / speed)
        self._knots += 1
        self._travels.append(self._knots * self._line.spacing)

    def _time_of(self, travel: float) -> float:
        return float(np.interp(travel, self._travels, self._times))
