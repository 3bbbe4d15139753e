# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gains and thresholds of the wavelet shrinkage for each belt speed."""

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from checkweigher_dsp.denoising.wavelet_shrinkage import LEVELS, Shrinkage

SHRUNK_LEVELS = (5, 6, 7)


@dataclass(frozen=True, slots=True)
class ShrinkageTable:
    """Shrinkage of the detail bands 5 to 7 for each belt speed. Bands 1 to 4 are removed.

    Raises
    ------
    ValueError
        If there is no speed, the speeds do not increase, or the columns differ in length.
    """

    # Belt speeds in m/s, ascending.
    speeds: tuple[float, ...]
    # Gains gamma and thresholds lambda of bands 5, 6 and 7, each with one value per speed.
    gains: tuple[tuple[float, ...], ...]
    thresholds: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if not self.speeds or any(a >= b for a, b in pairwise(self.speeds)):
            raise ValueError('at least one speed is needed, in increasing order')
        for row in (*self.gains, *self.thresholds):
            if len(row) != len(self.speeds):
                raise ValueError(
                    f'each gain and threshold needs {len(self.speeds)} values, one per speed, '
                    f'not {len(row)}'
                )

    def at(self, speed: Any, unit: float) -> tuple[Shrinkage | None, ...]:
        """Return the shrinkage of bands 1 to 7 at a belt speed, with None for each removed band.

        A band is also removed if all its gains in the table are 0. Gains and thresholds are
        interpolated linearly between the speeds of the table, and constant beyond them. Gains and
        thresholds have the shape of `speed`, the belt speed in m/s as a float or (windows, 1). But
        a threshold is the float 0 if all thresholds of its band in the table are 0. `unit` is the
        unit of the thresholds in the table, as a multiple of the unit of the signal.

        Examples
        --------
        >>> band = TABLE_1.at(1.125, unit=1.0)[6]  # level 7 halfway between 60 and 75 m/min
        >>> print(f'{band.gain:.4f} {band.threshold:.1f}')
        0.8225 4.0
        """
        at = partial(np.interp, speed, self.speeds)
        shrunk = (
            Shrinkage(at(gains), unit * at(thresholds) if any(thresholds) else 0.0)
            if any(gains)
            else None
            for gains, thresholds in zip(self.gains, self.thresholds, strict=True)
        )
        return *[None] * (LEVELS - len(SHRUNK_LEVELS)), *shrunk


# Table for belt speeds of 30, 45, 60, 75 and 90 m/min, which is table 1 of Long et al.
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

# The gains of `UNTRAINED` were tuned on a simulated machine like the machine of Long et al., with
# an extrapolated disturbance as padding. The gain of band 7 increases with the belt speed, because
# the windows become shorter. Thresholds brought no improvement; docs/method.md contains the
# results.
UNTRAINED = ShrinkageTable(
    speeds=TABLE_1.speeds,
    gains=((0.0,) * 5, (0.0,) * 5, (0.1, 0.25, 0.5, 0.8, 1.0)),
    thresholds=((0.0,) * 5,) * 3,
)
