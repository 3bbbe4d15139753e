# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion of the belt and the products of a simulated line."""

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

# While a product crosses an end of the belt, the mass that moves with the platform changes in 16
# steps, so its error is at most 1/32 of the product mass.
_STAIRS = 16
_IMPACTS = 1000  # maximum number of impacts that were drawn, but have no product yet

STEADY = Variation(speed=0.0, length=0.0, spacing=0.0)


@dataclass(frozen=True, slots=True)
class Pass:
    """Passage of one product over the weigh belt."""

    mass: float  # mass of the product in kg
    t1: float  # time in s at which the product begins to enter the belt
    t2: float  # time in s at which the product is completely on the belt
    t3: float  # time in s at which the product begins to leave the belt
    t4: float  # time in s at which the product has left the belt
    travel: float  # travel of the belt at t1 in m
    impact: float  # standard normal random number to which the impact at entry is proportional
    length: float  # length of the product in m
    number: int  # number of the product, from 0


class BeltTravel:
    """Travel of the belt over time, and the passes of the products.

    `plan` must be called with increasing times. Passes that have ended are removed, so that the
    memory does not grow with the number of products.
    """

    def __init__(
        self,
        line: 'SimulationParameters',
        variation: Variation,
        random: np.random.Generator,
        products: np.random.Generator | None = None,
        next_mass: Callable[[], float] | None = None,
    ) -> None:
        """Create the belt of a line.

        `variation` contains the standard deviations of speed, length and spacing. The standard
        deviation of the spacing is limited so that products do not overlap. `random` supplies the
        random speeds and impacts, and `products` supplies the random lengths and spacings; by
        default, `random` supplies all of them. `next_mass` returns the mass of the next product in
        kg; by default, the masses of `line` are used cyclically.
        """
        # Planned passes that have not ended, in order of entry.
        self.passes: list[Pass] = []
        # Time in s at which the last product leaves the belt completely, or None if the pass of
        # this product is not planned yet, or if the line is endless.
        self.last_exit: float | None = None
        # The caller may set the attributes below. A new value takes effect in the next call of
        # `plan`; a new value of `resting` takes effect in the next call of `load` or `load_steps`.
        #
        # Speed of the belt in m/s.
        self.speed = line.speed
        # Whether products enter the belt.
        self.feed = True
        # Mass of each product in kg, or 0 for the masses of the line.
        self.mass = 0.0
        # Mass in kg that rests on the belt.
        self.resting = 0.0
        # Length of free belt between two products in m, or 0 for the spacing of the line.
        self.gap = 0.0
        # Masses in kg of products that are put on the infeed by hand. These products enter next,
        # even if `feed` is False. A mass of 0 selects the mass of the other products.
        self.by_hand: list[float] = []
        self._line = line
        self._speed_jitter = variation.speed
        self._length_jitter = variation.length * line.product_length
        self._spacing_jitter = min(variation.spacing, (line.spacing - line.product_length) / 5)
        self._random = random
        self._products = random if products is None else products
        self._next_mass = next_mass or cycle(line.masses).__next__
        self._planned = 0
        self._next = 0.0  # travel in m at which the next product enters
        self._knots = 0
        self._shift = 0.0  # travel in m by which changed gaps have shifted the products
        self._impacts: deque[float] = deque(maxlen=_IMPACTS)
        # The travel at any time is interpolated linearly between these points.
        self._times = [-1.0, line.lead_in]
        self._travels = [-(line.lead_in + 1.0) * line.speed, 0.0]

    def plan(self, begin: float, end: float) -> list[Pass]:
        """Remove passes that end before `begin`, and return the new passes that begin by `end`.

        `begin` and `end` are in s. Products that do not enter the belt, because `feed` is False,
        have no pass.
        """
        self.passes = [entry for entry in self.passes if entry.t4 >= begin]
        while self._times[1] < begin:
            del self._times[0], self._travels[0]
        while self._times[-1] <= end:
            self._extend()
        added: list[Pass] = []
        while not self._complete() and self._time_of(self._next) <= end:
            comes = self.feed or bool(self.by_hand)
            entry = self._next_pass()
            if comes:
                added.append(entry)
        self.passes += added
        return added

    def travel(self, time: Array) -> Array:
        """Return the travel since the first entry, (n,) in m, at `time`, (n,) in s.

        The travel is negative before the first entry. `time` must lie between the arguments of the
        latest call of `plan`.
        """
        return np.interp(time, self._times, self._travels)

    def load(self, time: Array, travel: Array) -> Array:
        """Return the mass on the belt, (n,) in kg.

        `time` contains times in s, (n,), and `travel` the belt travel at these times in m, (n,).
        """
        load = np.full(len(time), self.resting)
        for entry, touched in self.touched(time):
            load[touched] += entry.mass * self.share(entry, travel[touched])
        return load

    def touched(self, time: Array) -> Iterator[tuple[Pass, slice]]:
        """Yield each pass with the slice of `time`, (n,), in which its product is on the belt."""
        for entry in self.passes:
            yield entry, slice(*np.searchsorted(time, (entry.t1, entry.t4)))

    def load_steps(self, time: Array, travel: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the mass on the belt, as in `load`, rounded to a piecewise constant function.

        The first array contains the indices at which the mass changes, (m + 1,) from 0 to n. The
        second array contains the masses between these indices, (m,) in kg.
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
        """Return the fraction of a product that is on the belt, (n,), at travels, (n,) in m."""
        way = travel - entry.travel
        leaving = way - self._line.weigh_length
        return np.clip(way / entry.length, 0, 1) - np.clip(leaving / entry.length, 0, 1)

    def _complete(self) -> bool:
        return self._line.count > 0 and self._planned >= self._line.count

    def _next_pass(self) -> Pass:
        line = self._line
        entry, length, weigh_length = self._next, line.product_length, line.weigh_length
        number = self._planned
        spacing = line.product_length + self.gap if self.gap else line.spacing
        self._shift += spacing - line.spacing
        self._next = (number + 1) * line.spacing + self._shift
        if self._spacing_jitter or self._length_jitter:
            gap, longer = np.clip(self._products.standard_normal(2), -2.0, 2.0).tolist()
            length += self._length_jitter * longer
            self._next += 0.0 if self.gap else self._spacing_jitter * gap
        while self._travels[-1] < entry + weigh_length + length:
            self._extend()
        ways = (0.0, length, weigh_length, weigh_length + length)
        t1, t2, t3, t4 = (self._time_of(entry + way) for way in ways)
        mass = self._mass_of_product()
        # `_extend` draws one impact for each segment of the travel. If the gap is narrow, there are
        # more products than segments, so a further impact is drawn here.
        impact = self._impacts.popleft() if self._impacts else float(self._random.normal())
        self._planned += 1
        if self._complete():
            self.last_exit = t4
        return Pass(mass, t1, t2, t3, t4, entry, impact, length, number)

    def _mass_of_product(self) -> float:
        filled = self._next_mass()  # the filler advances even if the mass it returns is not used
        by_hand = self.by_hand.pop(0) if self.by_hand else 0.0
        return by_hand or self.mass or filled

    def _extend(self) -> None:
        jitter, impact = self._random.standard_normal(2)
        self._impacts.append(float(impact))
        speed = self.speed * (1 + self._speed_jitter * float(jitter))
        self._times.append(self._times[-1] + self._line.spacing / speed)
        self._knots += 1
        self._travels.append(self._knots * self._line.spacing)

    def _time_of(self, travel: float) -> float:
        return float(np.interp(travel, self._travels, self._times))
