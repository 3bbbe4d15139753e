# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Simulation of the filler that fills the products before they are weighed."""

from collections import deque
from collections.abc import Sequence
from itertools import cycle

import numpy as np


class Filler:
    """Filler that determines the masses of the products of a line.

    `masses` are the set points in kg, which are used cyclically. `drift` is the change of the mass
    per product in kg, and `spread` is the standard deviation of the mass in kg. `delay` is the
    number of products between filler and scale. The attribute `correction`, in kg, is added to the
    set points of the products that are filled next.
    """

    def __init__(
        self,
        masses: Sequence[float],
        drift: float,
        spread: float,
        delay: int,
        random: np.random.Generator,
    ) -> None:
        self.correction = 0.0
        self._set_points = cycle(masses)
        self._drift, self._spread, self._delay, self._random = drift, spread, delay, random
        self._filled = 0
        self._on_the_way: deque[float] = deque()

    def next_mass(self) -> float:
        """Return the mass of the next product on the scale in kg, at least 0.

        The filler is always `delay` products ahead of the scale.
        """
        while len(self._on_the_way) <= self._delay:
            mass = next(self._set_points) + self._drift * self._filled + self.correction
            self._filled += 1
            if self._spread:
                mass += self._spread * float(self._random.standard_normal())
            self._on_the_way.append(max(mass, 0.0))
        return self._on_the_way.popleft()
