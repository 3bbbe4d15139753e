# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Static calibration: zero and sensitivity from readings of known masses at rest.

    counts = zero_counts + counts_per_kg * mass

is fitted by weighted least squares. The variance of a point is that of its reading and that of its
mass, carried over by the sensitivity (effective variance: Orear, Am. J. Phys. 50, 912 (1982)).
Where the points scatter more than these two explain, the uncertainties are enlarged by the square
root of chi-squared over its degrees of freedom (Birge ratio): a cell that is not straight is not
known better than it is straight.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import GRAMS, LoadCell
from checkweigher_dsp.signal.averages import BATCHES, batch_mean_std_error

_LEAST_SAMPLES = 10 * BATCHES
_ITERATIONS = 10  # the variances depend on the sensitivity only weakly
_LOOK_PERIOD = 0.5  # s of signal, after which a load is judged again
_LEAST_SPAN = 100.0  # of the sensitivity over its uncertainty
# counts; a reading that does not move at all still stands for a step of the converter.
_QUANTISATION = 1 / math.sqrt(12)


class CalibrationError(ValueError):
    """A calibration that cannot be made or used; one line that says why."""


@dataclass(frozen=True, slots=True)
class StaticReading:
    """Reading of a load at rest, counts."""

    mean: float
    std_error: float  # standard uncertainty of the mean, by those of ten successive batches
    drift: float  # mean of the second half less that of the first
    noise: float  # standard deviation of the samples

    def is_stable(self, tolerance: float) -> bool:
        """Tell whether the halves agree to within `tolerance` counts, and the mean is known to."""
        return abs(self.drift) <= tolerance and self.std_error <= tolerance


def read_static(counts: NDArray[np.int32], min_counts: int, max_counts: int) -> StaticReading:
    """Return the reading of a load at rest from successive samples, (n,) int32.

    Raises CalibrationError if the samples are too few or at a limit of the converter.
    """
    if len(counts) < _LEAST_SAMPLES:
        raise CalibrationError(f'{len(counts)} samples are too few, {_LEAST_SAMPLES} are needed')
    if np.any((counts <= min_counts) | (counts >= max_counts)):
        raise CalibrationError(
            'the converter is at its limit; check overload, load-cell wiring and the range'
        )
    values = counts.astype(np.float64)
    half = len(values) // 2
    return StaticReading(
        mean=float(np.mean(values)),
        std_error=batch_mean_std_error(values),
        drift=float(np.mean(values[half:]) - np.mean(values[:half])),
        noise=float(np.std(values, ddof=1)),
    )


@dataclass(frozen=True, slots=True)
class Steadiness:
    """Limits within which a load counts as being at rest."""

    duration: float = 5.0  # s, for which the load is read
    tolerance: float = 1e-4  # kg, by which the two halves of the reading may differ
    patience: float = 60.0  # s, after which the reading is given up


class RestReading:
    """Reading of a load, taken as soon as it has been at rest for long enough.

    The present sensitivity of `load_cell` turns the tolerance of `steadiness` into counts. `latest`
    is the reading of the latest samples, at rest or not, None before the first.
    """

    def __init__(self, load_cell: LoadCell, steadiness: Steadiness) -> None:
        self._load_cell = load_cell
        self._steadiness = steadiness
        self._least = max(1, round(steadiness.duration * load_cell.sample_rate))
        self._counts = np.zeros(0, np.int32)
        self._seen = self._looked = self._gaps = 0
        self.latest: StaticReading | None = None

    def add(self, counts: NDArray[np.int32], *, whole: bool = True) -> StaticReading | None:
        """Take samples, (n,), and return the reading if the load has been at rest long enough.

        `whole` tells whether they follow on the samples before: the reading begins again after a
        loss, which may hide a movement. Raises CalibrationError if the converter is at its limit,
        or the load has not come to rest in time.
        """
        rate, wanted = self._load_cell.sample_rate, self._steadiness
        self._gaps += not whole
        self._counts = np.concatenate([self._counts[-self._least :], counts]) if whole else counts
        self._seen += len(counts)
        if self._seen - self._looked < _LOOK_PERIOD * rate:
            return None
        self._looked = self._seen
        complete = len(self._counts) >= self._least
        limits = self._load_cell.min_counts, self._load_cell.max_counts
        try:
            self.latest = read_static(self._counts[-self._least :], *limits)
        except CalibrationError:
            if complete:
                raise
        tolerance = wanted.tolerance * abs(self._load_cell.counts_per_kg)
        if complete and self.latest is not None and self.latest.is_stable(tolerance):
            return self.latest
        if self._seen > wanted.patience * rate:
            raise CalibrationError(self._why_not())
        return None

    @property
    def duration(self) -> float:
        """Time for which the load has been read, s, at most that of `Steadiness`."""
        return min(len(self._counts), self._least) / self._load_cell.sample_rate

    def _why_not(self) -> str:
        wanted = self._steadiness
        if self._gaps:
            return (
                f'samples were lost {self._gaps} times in {wanted.patience:g} s; check the cable '
                'of the load cell and the load on the machine'
            )
        assert self.latest is not None
        per_gram = abs(self._load_cell.counts_per_kg) / GRAMS
        return (
            f'the load did not come to rest within {wanted.patience:g} s: the halves of '
            f'{wanted.duration:g} s differ by {self.latest.drift / per_gram:.3f} g, its mean is '
            f'known to {self.latest.std_error / per_gram:.3f} g, and both must be within '
            f'{GRAMS * wanted.tolerance:g} g; check for wind, vibration and what touches the belt'
        )


@dataclass(frozen=True, slots=True)
class CalibrationPoint:
    """A known mass and its reading, with standard uncertainties."""

    mass: float  # kg, 0 for the empty belt
    reading: float  # counts
    reading_uncertainty: float
    mass_uncertainty: float = 0.0


@dataclass(frozen=True, slots=True)
class StaticCalibration:
    """Zero (counts) and sensitivity (counts/kg) with standard uncertainties."""

    zero_counts: float
    counts_per_kg: float
    zero_uncertainty: float
    counts_per_kg_uncertainty: float
    correlation: float  # of zero and sensitivity
    # kg, of each point: the mass that the calibration gives its reading, less its true mass.
    residuals: tuple[float, ...]
    # Scatter of the points over the scatter that their uncertainties explain; NaN where there are
    # no more points than unknowns.
    birge_ratio: float

    @property
    def largest_residual(self) -> float:
        """Largest residual, kg, without its sign."""
        return max(map(abs, self.residuals))

    def mass_uncertainty(self, mass: float) -> float:
        """Return the standard uncertainty that the calibration gives a mass, kg."""
        zero, slope = self.zero_uncertainty, mass * self.counts_per_kg_uncertainty
        # A sum of squares: where the two cancel, zero^2 + 2 c zero slope + slope^2 may be negative.
        apart = slope * math.sqrt(max(1 - self.correlation**2, 0.0))
        return math.hypot(zero + self.correlation * slope, apart) / abs(self.counts_per_kg)


def calibrate(points: Sequence[CalibrationPoint]) -> StaticCalibration:
    """Fit zero and sensitivity by weighted least squares with effective variances.

    The points need at least two different masses; the same mass may come several times. Raises
    CalibrationError if the points do not determine both.
    """
    values = np.array([astuple(point) for point in points]).reshape(-1, 4)
    masses, readings, of_readings, of_masses = values.T
    if not np.isfinite(values).all():
        raise CalibrationError('a point is not a finite number')
    if np.any(of_readings < 0) or np.any(of_masses < 0):
        raise CalibrationError('an uncertainty is negative')
    if len(np.unique(masses)) < 2:
        raise CalibrationError('at least two different masses are needed, one may be none')
    of_readings = np.maximum(of_readings, _QUANTISATION)
    slope, _ = np.polyfit(masses, readings, 1)
    for _ in range(_ITERATIONS):
        sigma = np.hypot(of_readings, slope * of_masses)
        (slope, zero), covariance = np.polyfit(masses, readings, 1, w=1 / sigma, cov='unscaled')
    misfits = readings - zero - slope * masses
    freedom = len(points) - 2
    birge = math.sqrt(np.sum((misfits / sigma) ** 2) / freedom) if freedom else math.nan
    deviations = np.sqrt(np.diag(covariance))
    slope_uncertainty, zero_uncertainty = deviations * (birge if birge > 1 else 1.0)
    if abs(slope) < _LEAST_SPAN * slope_uncertainty:
        raise CalibrationError(
            'the readings hardly differ between the masses; check that they rest on the belt, and '
            'the load-cell wiring'
        )
    return StaticCalibration(
        zero_counts=float(zero),
        counts_per_kg=float(slope),
        zero_uncertainty=float(zero_uncertainty),
        counts_per_kg_uncertainty=float(slope_uncertainty),
        correlation=float(covariance[0, 1] / np.prod(deviations)),
        residuals=tuple((misfits / slope).tolist()),
        birge_ratio=birge,
    )


def zero_only(empty: CalibrationPoint, counts_per_kg: float) -> StaticCalibration:
    """Return a calibration with a new reading of the empty belt and a sensitivity that stays.

    The uncertainty of that sensitivity is not known: NaN.
    """
    return StaticCalibration(
        zero_counts=empty.reading,
        counts_per_kg=counts_per_kg,
        zero_uncertainty=max(empty.reading_uncertainty, _QUANTISATION),
        counts_per_kg_uncertainty=math.nan,
        correlation=0.0,
        residuals=(0.0,),
        birge_ratio=math.nan,
    )
