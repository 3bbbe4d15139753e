# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Session of a calibration, in which known masses are read while no product passes."""

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
_LONGEST = 3600.0  # longest duration of a session in s, because the zero drifts


@dataclass(frozen=True)
class CalibrationParameters(Parameters):
    """Calibration file of the machine, and limits of a load at rest."""

    node: ClassVar[str] = 'calibration'

    file: str = parameter(
        '',
        'calibration of this machine: its values override the parameters of the source, and '
        'the services write it; empty for none',
    )
    duration: float = parameter(
        5.0, 'time for which each mass is read', unit='s', minimum=0.5, maximum=600
    )
    tolerance: float = parameter(
        1e-4, 'largest change of a load at rest', unit='kg', minimum=1e-9, maximum=1e6
    )
    patience: float = parameter(
        30.0,
        'time after which a load that does not come to rest is given up',
        unit='s',
        minimum=1,
        maximum=3600,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.patience <= self.duration:
            raise ParameterError(
                f'calibration.patience: {self.patience:g} s is not above calibration.duration '
                f'{self.duration:g} s'
            )

    @property
    def steadiness(self) -> Steadiness:
        """Limits of a load at rest."""
        return Steadiness(self.duration, self.tolerance, self.patience)

    @property
    def path(self) -> Path | None:
        """Path of the calibration file, None if there is none."""
        return Path(self.file) if self.file else None


class CalibrationSession:
    """Session of a calibration. Loads are read one after the other, then `finish` fits the points.

    A session is either idle or reads a load. `begin` starts to read a load. The session is idle
    again when the load was read, after an error, or after `cancel`.
    """

    def __init__(self, load_cell: LoadCell, steadiness: Steadiness) -> None:
        self.load_cell = load_cell
        self._steadiness = steadiness
        self._began = math.nan
        self.points: list[CalibrationPoint] = []
        self.reading: RestReading | None = None  # None while idle
        self._load = (0.0, 0.0)  # mass and uncertainty in kg of the load that is read

    def begin(self, mass: float, uncertainty: float, edges: Collection[EyeEdge]) -> None:
        """Begin to read a load with its mass and uncertainty in kg, both 0 for the empty belt.

        `edges` has the latest edge of each photo-eye. Raises CalibrationError if the load cannot be
        read now.
        """
        if self.reading is not None:
            raise CalibrationError('a load is being read already; wait for the answer')
        if not (math.isfinite(mass) and math.isfinite(uncertainty) and uncertainty >= 0):
            raise CalibrationError(
                f'mass {mass:g} kg, uncertainty {uncertainty:g} kg: both must be finite numbers, '
                'the latter not negative'
            )
        if mass == 0:
            _check_clear(edges)
        self._load = mass, uncertainty
        self.reading = RestReading(self.load_cell, self._steadiness)

    def add(self, event: SampleBlock | EyeEdge, now: float) -> StaticReading | None:
        """Process an event of the stream; return the reading if it is complete.

        `now` is the time in s on a monotonic clock. Raises CalibrationError if the load cannot be
        read; no point is then added.
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

    def cancel(self) -> None:
        """Cancel the reading."""
        self.reading = None

    def finish(
        self, max_residual: float, edges: Collection[EyeEdge], stamp: int, now: float
    ) -> StaticCalibration:
        """Return the calibration that fits the points.

        `max_residual` is the largest valid residual in kg; if it is 0, all are valid. `edges` has
        the latest edge of each photo-eye. `stamp` is the stamp of the last block in ns, and `now`
        is the time in s on the clock of `add`. Raises CalibrationError if the points do not
        determine a calibration, or if a product may be on the belt.
        """
        if self.reading is not None:
            raise CalibrationError('a load is being read; wait for its answer')
        if not self.points:
            raise CalibrationError('no load was read; call calibrate_zero and calibrate_span first')
        if now - self._began > _LONGEST:
            raise CalibrationError(
                f'the first load was read more than {_LONGEST / 60:.0f} min ago, and the zero '
                'drifts; call cancel_calibration and begin again'
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
                f'a mass is {GRAMS * found.largest_residual:.3f} g off the line, more than '
                f'{GRAMS * max_residual:g} g; check the masses and what touches the belt, then '
                'call cancel_calibration and begin again'
            )
        return found

    def _calibration(self) -> StaticCalibration:
        if any(point.mass for point in self.points):
            return calibrate(self.points)
        if len(self.points) > 1:
            raise CalibrationError(
                'the empty belt was read several times, and no mass; call calibrate_span, or '
                'cancel_calibration and read it once'
            )
        return zero_only(self.points[0], self.load_cell.counts_per_kg)


def _check_clear(edges: Collection[EyeEdge]) -> None:
    """Raise CalibrationError if a photo-eye is blocked after its latest edge."""
    for edge in edges:
        if edge.blocked:
            raise CalibrationError(
                f'the {Eye(edge.eye).name.lower()} eye is blocked; empty the belt'
            )
