# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A simulated filler: it drifts, scatters, and takes a correction that the scale sees later."""

from collections import deque
from collections.abc import Sequence
from itertools import cycle

import numpy as np


class Filler:
    """The masses of the products of a line, in order.

    Parameters
    ----------
    masses : sequence of float
        kg, set points, taken in turn.
    drift : float
        kg, from one product to the next.
    spread : float
        kg, standard deviation from product to product.
    delay : int
        Products that are filled and not yet on the scale.
    random : numpy.random.Generator
        Of the spread.

    Attributes
    ----------
    correction : float
        kg, added to the set point of what is filled from now on.
    """

    def __init__(
        self, masses: Sequence[float], drift: float, spread: float, delay: int,
        random: np.random.Generator,
    ) -> None:  # fmt: skip
        self.correction = 0.0
        self._set_points = cycle(masses)
        self._drift, self._spread, self._delay, self._random = drift, spread, delay, random
        self._filled = 0
        self._on_the_way: deque[float] = deque()

    def next_mass(self) -> float:
        """Return the mass of the product that reaches the scale next, kg, never below 0."""
        while len(self._on_the_way) <= self._delay:
            self._on_the_way.append(self._fill())
        return self._on_the_way.popleft()

    def _fill(self) -> float:
        mass = next(self._set_points) + self._drift * self._filled + self.correction
        self._filled += 1
        if self._spread:
            mass += self._spread * float(self._random.standard_normal())
        return max(mass, 0.0)
