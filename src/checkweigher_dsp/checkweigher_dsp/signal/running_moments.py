# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Running mean and standard deviation of a stream of values."""

import math


class RunningMoments:
    """Running count, mean and standard deviation (Welford, Technometrics 4 (1962) 419)."""

    def __init__(self) -> None:
        self.count = 0
        self._mean = self._squares = 0.0  # sum of squared deviations from the mean

    def add(self, value: float) -> None:
        """Add a value."""
        self.count += 1
        before = value - self._mean
        self._mean += before / self.count
        self._squares += before * (value - self._mean)

    @property
    def mean(self) -> float:
        """Mean, or NaN without values."""
        return self._mean if self.count else math.nan

    @property
    def std_dev(self) -> float:
        """Standard deviation, or NaN for fewer than two values."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else math.nan
