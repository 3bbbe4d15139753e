# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Positions of the products of a simulated line: entries and exits of the weigh belt."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# A product that is half on the belt also moves half with it. Its share is taken as constant over
# 1/16 of the crossing: the platform's mass is then wrong by at most 1/32 of the product's.
_STAIRS = 16


@dataclass(frozen=True, slots=True)
class Line:
    """Products on a belt."""

    speed: float  # m/s, mean
    speed_jitter: float  # relative standard deviation; a new speed holds from each entry on
    spacing: float  # m, as the two lengths
    product_length: float
    weigh_length: float
    masses: tuple[float, ...]  # kg, taken in turn
    count: int  # 0 for no end
    first_entry: float  # s, t1 of the first product


@dataclass(frozen=True, slots=True)
class Pass:
    """One product crossing the weigh belt."""

    mass: float  # kg
    t1: float  # s, begins to enter
    t2: float  # s, is fully on
    t3: float  # s, begins to leave
    t4: float  # s, is gone
    travel: float  # m, of the belt at t1
    impact: float  # standard normal number: sign and size of its impact at entry


class BeltTravel:
    """Travel of the belt over time and the passes on it.

    Time only moves on: what is over is forgotten, so an endless line needs no more memory than a
    short one. `passes` are those that are planned and not over, in order of entry; `last_exit` is
    t4 of the last product, s, once it is planned.
    """

    def __init__(self, line: Line, random: np.random.Generator) -> None:
        self.passes: list[Pass] = []
        self.last_exit: float | None = None
        self._line = line
        self._random = random
        self._planned = 0
        self._knots = 0
        self._impacts: deque[float] = deque()
        # Time and travel where the belt changes its speed: at each entry, and one knot before
        # everything, from where the belt runs up to the first.
        self._times = [-1.0, line.first_entry]
        self._travels = [-(line.first_entry + 1.0) * line.speed, 0.0]

    def plan(self, begin: float, end: float) -> list[Pass]:
        """Forget what is over at `begin`, return the entries planned up to `end`; both in s."""
        self.passes = [entry for entry in self.passes if entry.t4 >= begin]
        while self._times[1] < begin:
            del self._times[0], self._travels[0]
        while self._times[-1] <= end:
            self._extend()
        added: list[Pass] = []
        while not self._complete() and self._time_of(self._planned * self._line.spacing) <= end:
            added.append(self._next_pass())
        self.passes += added
        return added

    def travel(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the travel in m since the first entry, at times (n,) within the plan."""
        return np.interp(time, self._times, self._travels)

    def load(self, time: NDArray[np.float64], travel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mass in kg that rests on the belt at times (n,) and their travels."""
        load = np.zeros(len(time))
        for entry in self.passes:
            touched = slice(*np.searchsorted(time, (entry.t1, entry.t4)))
            load[touched] += entry.mass * self._share(travel[touched] - entry.travel)
        return load

    def load_steps(
        self, time: NDArray[np.float64], travel: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Return where the mass that moves with the platform changes, in stairs.

        These are the steps at which it changes, (m + 1,) from 0 to n, and the mass on the platform
        from each of them to the next, (m,) in kg.
        """
        steps = [np.array((0, len(time)))]
        for entry in self.passes:
            for begin, end in ((entry.t1, entry.t2), (entry.t3, entry.t4)):
                steps.append(np.searchsorted(time, np.linspace(begin, end, _STAIRS + 1)))
        bounds = np.unique(np.concatenate(steps))
        middle = travel[(bounds[:-1] + bounds[1:]) // 2]
        mass = np.zeros(len(middle))
        for entry in self.passes:
            share = self._share(middle - entry.travel)
            stair = (np.floor(share * _STAIRS) + 0.5) / _STAIRS
            mass += entry.mass * np.where((share > 0) & (share < 1), stair, share)
        return bounds, mass

    def _share(self, travel: NDArray[np.float64]) -> NDArray[np.float64]:
        length = self._line.product_length
        leaving = travel - self._line.weigh_length
        return np.clip(travel / length, 0, 1) - np.clip(leaving / length, 0, 1)

    def _complete(self) -> bool:
        return self._line.count > 0 and self._planned >= self._line.count

    def _next_pass(self) -> Pass:
        line = self._line
        entry = self._planned * line.spacing
        exit_travel = entry + line.weigh_length + line.product_length
        while self._travels[-1] < exit_travel:
            self._extend()
        length, weigh_length = line.product_length, line.weigh_length
        ways = (0.0, length, weigh_length, weigh_length + length)
        t1, t2, t3, t4 = (self._time_of(entry + way) for way in ways)
        mass = line.masses[self._planned % len(line.masses)]
        self._planned += 1
        if self._complete():
            self.last_exit = t4
        return Pass(mass, t1, t2, t3, t4, entry, self._impacts.popleft())

    def _extend(self) -> None:
        jitter, impact = self._random.standard_normal(2)
        self._impacts.append(float(impact))
        speed = self._line.speed * (1 + self._line.speed_jitter * float(jitter))
        self._times.append(self._times[-1] + self._line.spacing / speed)
        self._knots += 1
        self._travels.append(self._knots * self._line.spacing)

    def _time_of(self, travel: float) -> float:
        return float(np.interp(travel, self._travels, self._times))
