"""Gains and thresholds of the wavelet shrinkage for each belt speed, Table 1 of the paper first."""

from bisect import bisect_left
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from checkweigher_dsp.denoising.wavelet_shrinkage import LEVELS, Shrinkage

SHRUNK_LEVELS = (5, 6, 7)


@dataclass(frozen=True, slots=True)
class ShrinkageTable:
    """Shrinkage of the detail bands 5 to 7 by belt speed; the bands above are removed.

    Attributes
    ----------
    speeds : tuple of float
        m/s, ascending.
    gains : tuple of tuple of float
        gamma of levels 5, 6 and 7, each one value per speed.
    thresholds : tuple of tuple of float
        lambda of levels 5, 6 and 7, each one value per speed, in a unit of the table's own.

    Raises
    ------
    ValueError
        If the columns differ in length or the speeds do not ascend.
    """

    speeds: tuple[float, ...]
    gains: tuple[tuple[float, ...], ...]
    thresholds: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if not self.speeds or any(a >= b for a, b in pairwise(self.speeds)):
            raise ValueError('speeds must ascend and there must be one at least')
        for row in (*self.gains, *self.thresholds):
            if len(row) != len(self.speeds):
                raise ValueError(f'{len(row)} values for {len(self.speeds)} speeds')

    @property
    def is_linear(self) -> bool:
        """Whether there is no threshold at any speed: then what denoises is a linear filter."""
        return not any(any(row) for row in self.thresholds)

    def at(self, speed: Any, unit: float) -> tuple[Shrinkage | None, ...]:
        """Return the shrinkage of levels 1 to 7 at a belt speed.

        Between the speeds of the table it is interpolated linearly, outside it is that of the
        nearest one.

        Parameters
        ----------
        speed : float or ndarray, (passes,)
            m/s; an array makes gains and thresholds arrays (passes, 1).
        unit : float
            What one unit of the thresholds is in the signal's unit.
        """
        found: list[Shrinkage | None] = [None] * (LEVELS - len(SHRUNK_LEVELS))
        for gains, thresholds in zip(self.gains, self.thresholds, strict=True):
            if any(gains):
                rest = unit * column(self.speeds, thresholds, speed) if any(thresholds) else 0.0
                found.append(Shrinkage(column(self.speeds, gains, speed), rest))
            else:
                found.append(None)
        return tuple(found)


def interpolate(positions: tuple[float, ...], values: tuple[float, ...], at: float) -> float:
    """Interpolate linearly; before the first and after the last position the value is constant."""
    right = bisect_left(positions, at)
    if right == 0:
        return values[0]
    if right == len(positions):
        return values[-1]
    share = (at - positions[right - 1]) / (positions[right] - positions[right - 1])
    return values[right - 1] + share * (values[right] - values[right - 1])


def column(positions: tuple[float, ...], values: tuple[float, ...], at: Any) -> Any:
    """Interpolate at one position, or at several (passes,) with the same bits: (passes, 1)."""
    if isinstance(at, np.ndarray):
        return np.array([[interpolate(positions, values, each)] for each in at.tolist()])
    return interpolate(positions, values, at)


# Long et al., Table 1, at 30, 45, 60, 75 and 90 m/min.
TABLE_1 = ShrinkageTable(
    speeds=(0.5, 0.75, 1.0, 1.25, 1.5),
    gains=(
        (0.080, 0.040, 0.110, 0.080, 0.100),
        (0.385, 0.351, 0.580, 0.523, 0.590),
        (0.850, 0.847, 0.856, 0.789, 0.860),
    ),
    thresholds=(
        (150.0, 130.0, 350.0, 220.0, 260.0),
        (14.0, 13.0, 40.0, 26.0, 30.0),
        (3.0, 3.0, 4.0, 4.0, 5.0),
    ),
)

# Found on simulated passes of a machine like the paper's, with the disturbance continued around
# the window: there the faster belt leaves the shorter window, and with it the more in band 7.
# No threshold did better than the gain alone; docs/method.md has the figures.
UNTRAINED = ShrinkageTable(
    speeds=TABLE_1.speeds,
    gains=((0.0,) * 5, (0.0,) * 5, (0.1, 0.25, 0.5, 0.8, 1.0)),
    thresholds=((0.0,) * 5,) * 3,
)
