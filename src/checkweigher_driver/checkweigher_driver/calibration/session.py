# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibration session, in which known masses are read while no product passes."""

from collections.abc import Collection
from dataclasses import dataclass
import math
from pathlib import Path
from typing import ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import GRAMS, NANOSECONDS, Eye, EyeEdge, LoadCell, SampleBlock
from checkweigher_driver.calibration.static_calibration import (
    CalibrationError,
    CalibrationPoint,
    RestReading,
    StaticCalibration,
    StaticReading,
    Steadiness,
    calibrate,
    zero_only,
)

_QUIET = 2 * NANOSECONDS  # time in ns without an edge after which the belt counts as empty
_LONGEST = 3600.0  # longest time in s from the first reading to the fit, because the zero drifts


@dataclass(frozen=True)
class CalibrationParameters(Parameters):
    """Parameters of the calibration file, and of the readings of loads at rest."""

    node: ClassVar[str] = 'calibration'

    file: str = parameter(
        '',
        'calibration file of this machine, which overrides the parameters of the source; the '
        'calibration services write it; empty for none',
    )
    duration: float = parameter(
        5.0, 'time for which each mass is read', unit='s', minimum=0.5, maximum=600
    )
    tolerance: float = parameter(
        1e-4, 'largest drift and standard error of a reading', unit='kg', minimum=1e-9, maximum=1e6
    )
    patience: float = parameter(
        30.0,
        'time after which the reading of a load that does not come to rest is cancelled',
        unit='s',
        minimum=1,
        maximum=3600,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.patience <= self.duration:
            raise ParameterError(
                f'calibration.patience: {self.patience:g} s must be longer than '
                f'calibration.duration {self.duration:g} s'
            )

    @property
    def steadiness(self) -> Steadiness:
        """Limits within which a load counts as at rest."""
        return Steadiness(self.duration, self.tolerance, self.patience)

    @property
    def path(self) -> Path | None:
        """Path of the calibration file, or None if the parameter `file` is empty."""
        return Path(self.file) if self.file else None


class CalibrationSession:
    """Calibration session, in which known masses are read one after the other.

    Each complete reading becomes a point, and `finish` fits a calibration to the points. A session
    is idle if `reading` is None; otherwise it reads a load. `begin` starts to read a load. The
    session is idle again when the load has been read, or after an error.
    """

    def __init__(self, load_cell: LoadCell, steadiness: Steadiness) -> None:
        self.load_cell = load_cell
        self._steadiness = steadiness
        self._began = math.nan
        self.points: list[CalibrationPoint] = []
        self.reading: RestReading | None = None
        self._load = (0.0, 0.0)  # mass and uncertainty in kg of the load that is read

    def begin(self, mass: float, uncertainty: float, edges: Collection[EyeEdge]) -> None:
        """Begin to read a load with its mass and uncertainty in kg, both 0 for the empty belt.

        `edges` contains the latest edge of each photo-eye. Raises CalibrationError if another load
        is being read, if the mass or the uncertainty is not finite, if the uncertainty is negative,
        or if the mass is 0 and an eye is blocked.
        """
        if self.reading is not None:
            raise CalibrationError('a load is being read already; wait for the answer')
        if not (math.isfinite(mass) and math.isfinite(uncertainty) and uncertainty >= 0):
            raise CalibrationError(
                f'mass {mass:g} kg, uncertainty {uncertainty:g} kg: both must be finite, and the '
                'uncertainty must not be negative'
            )
        if mass == 0:
            _check_clear(edges)
        self._load = mass, uncertainty
        self.reading = RestReading(self.load_cell, self._steadiness)

    def add(self, event: SampleBlock | EyeEdge, now: float) -> StaticReading | None:
        """Add an event to the reading; return the reading if it is complete, otherwise None.

        A complete reading becomes a point. The event is ignored if no load is being read. `now` is
        the time in s on a monotonic clock. Raises CalibrationError if the event is an edge, or if
        the reading fails. After an error no point is added, and the session is idle.
        """
        reading, self.reading = self.reading, None  # idle after an error
        if reading is None:
            return None
        if isinstance(event, EyeEdge):
            raise CalibrationError(
                f'the {Eye(event.eye).name.lower()} eye has switched while the load was read; '
                'stop the feed, and keep clear of the belt'
            )
        found = reading.add(event)
        if found is None:
            self.reading = reading
            return None
        if not self.points:
            self._began = now
        mass, uncertainty = self._load
        self.points.append(CalibrationPoint(mass, found.mean, found.std_error, uncertainty))
        return found

    def finish(
        self, max_residual: float, edges: Collection[EyeEdge], stamp: int, now: float
    ) -> StaticCalibration:
        """Return the calibration that fits the points.

        If the only point is the empty belt, the sensitivity of the load cell is kept.

        `max_residual` is the largest valid residual in kg; if it is 0, all residuals are valid.
        `edges` contains the latest edge of each photo-eye. `stamp` is the stamp of the latest block
        in ns, and `now` is the time in s on the same monotonic clock as in `add`.

        Raises CalibrationError if there are no points, if the points do not determine a
        calibration, if a residual is too large, if the first point is more than an hour old, if a
        load is being read, or if an eye is blocked or has switched within the last 2 s.
        """
        if self.reading is not None:
            raise CalibrationError('a load is being read; wait for the answer')
        if not self.points:
            raise CalibrationError('no load was read; read the empty belt and known masses first')
        if now - self._began > _LONGEST:
            raise CalibrationError(
                f'the first load was read more than {_LONGEST / 60:.0f} min ago, and the zero '
                'drifts; begin again'
            )
        _check_clear(edges)
        if any(stamp - edge.stamp < _QUIET for edge in edges):
            raise CalibrationError(
                f'an eye has switched within the last {_QUIET / NANOSECONDS:g} s; stop the feed, '
                'and wait until nothing passes'
            )
        found = self._calibration()
        if max_residual > 0 and found.largest_residual > max_residual:
            raise CalibrationError(
                f'the largest residual is {GRAMS * found.largest_residual:.3f} g, more than '
                f'{GRAMS * max_residual:g} g; check the masses, and that nothing touches the belt, '
                'then begin again'
            )
        return found

    def _calibration(self) -> StaticCalibration:
        if any(point.mass for point in self.points):
            return calibrate(self.points)
        if len(self.points) > 1:
            raise CalibrationError(
                'only the empty belt was read, and several times; read a known mass, or begin '
                'again and read the empty belt once'
            )
        return zero_only(self.points[0], self.load_cell.counts_per_kg)


def _check_clear(edges: Collection[EyeEdge]) -> None:
    """Raise CalibrationError if a photo-eye is blocked, according to its latest edge."""
    for edge in edges:
        if edge.blocked:
            raise CalibrationError(
                f'the {Eye(edge.eye).name.lower()} eye is blocked; empty the belt'
            )
