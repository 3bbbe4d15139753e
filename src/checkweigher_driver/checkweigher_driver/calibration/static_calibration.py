# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Static calibration: zero and sensitivity from readings of known masses at rest.

The model ``counts = zero_counts + counts_per_kg * mass`` is fitted by weighted least squares. The
variance of a point is the variance of its reading plus the variance of its mass in counts (Orear,
American Journal of Physics 50, 912, 1982). If the residuals are larger than these variances
explain, for instance because the cell is not linear, the uncertainties are multiplied by the Birge
ratio. The Birge ratio is the square root of chi-squared per degree of freedom.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import GRAMS, LoadCell, SampleBlock
from checkweigher_dsp.signal.averages import BATCHES, batch_mean_std_error

_LEAST_SAMPLES = 10 * BATCHES
_ITERATIONS = 10  # number of iterations of the fit, which converges fast
_LOOK_PERIOD = 0.5  # time in s between two checks whether a load is at rest
_LEAST_SPAN = 100.0  # smallest allowed ratio of the sensitivity to its uncertainty
_QUANTISATION = 1 / math.sqrt(12)  # standard uncertainty in counts due to rounding to counts


class CalibrationError(ValueError):
    """Raised if a calibration fails or is invalid. The message is one line with the reason."""


@dataclass(frozen=True, slots=True)
class StaticReading:
    """Reading of a load at rest. All values are in counts."""

    mean: float
    std_error: float  # standard uncertainty of the mean, computed from the means of ten batches
    drift: float  # mean of the second half minus mean of the first half
    noise: float  # standard deviation of the samples

    def is_stable(self, tolerance: float) -> bool:
        """Return whether absolute drift and standard error are at most `tolerance` in counts."""
        return abs(self.drift) <= tolerance and self.std_error <= tolerance


def read_static(counts: NDArray[np.int32], min_counts: int, max_counts: int) -> StaticReading:
    """Return the reading of a load at rest from consecutive samples of shape (n,).

    Raises CalibrationError if there are fewer samples than `_LEAST_SAMPLES`, or if a sample is at
    or beyond a limit of the converter.
    """
    if len(counts) < _LEAST_SAMPLES:
        raise CalibrationError(f'{len(counts)} samples are too few; {_LEAST_SAMPLES} are needed')
    if np.any((counts <= min_counts) | (counts >= max_counts)):
        raise CalibrationError(
            'the converter is at its limit; check for overload, and check the load-cell wiring and '
            'the range'
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
    """Limits within which a load counts as at rest, and the time for which they must hold."""

    duration: float = 5.0  # duration of the reading in s
    tolerance: float = 1e-4  # largest drift and standard error of the reading in kg
    patience: float = 60.0  # time in s after which the reading of a moving load is cancelled


class RestReading:
    """Measurement of a load, which waits until the load has been at rest for the required time.

    The required time is `steadiness.duration`. The sensitivity of `load_cell` converts the
    tolerance of `steadiness` to counts. `latest` is the reading of the samples at the latest check,
    even if the load moves. `latest` is None until a check has had enough samples, all of them
    strictly within the limits of the converter.
    """

    def __init__(self, load_cell: LoadCell, steadiness: Steadiness) -> None:
        self._load_cell = load_cell
        self._steadiness = steadiness
        self._least = max(1, round(steadiness.duration * load_cell.sample_rate))
        self._counts = np.zeros(0, np.int32)
        self._seen = self._looked = self._gaps = 0
        self._next: int | None = None  # index of the next sample if none is lost
        self.latest: StaticReading | None = None

    def add(self, block: SampleBlock) -> StaticReading | None:
        """Add a block; return the reading if the load was at rest for the required time, or None.

        The load is checked every 0.5 s of samples. After a loss of samples the measurement begins
        again, because the load may have moved. However, the time limit `patience` does not begin
        again. Raises CalibrationError if a complete measurement contains a sample at or beyond a
        limit of the converter, or if the load has not come to rest within the time limit.
        """
        rate, wanted, counts = self._load_cell.sample_rate, self._steadiness, block.counts
        whole = self._next in (None, block.first_index)
        self._next = block.first_index + len(counts)
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
            raise CalibrationError(self._failure_text())
        return None

    @property
    def duration(self) -> float:
        """Duration in s of the samples in the reading so far, at most `Steadiness.duration`."""
        return min(len(self._counts), self._least) / self._load_cell.sample_rate

    def _failure_text(self) -> str:
        wanted = self._steadiness
        if self._gaps:
            return (
                f'samples were lost {self._gaps} times in {wanted.patience:g} s; check the cable '
                'of the load cell and the CPU load of this computer'
            )
        assert self.latest is not None
        per_gram = abs(self._load_cell.counts_per_kg) / GRAMS
        return (
            f'the load did not come to rest within {wanted.patience:g} s: in {wanted.duration:g} s '
            f'it drifts by {self.latest.drift / per_gram:.3f} g with a standard error of '
            f'{self.latest.std_error / per_gram:.3f} g, and both must be within '
            f'{GRAMS * wanted.tolerance:g} g; check for wind, vibration and contact with the belt'
        )


@dataclass(frozen=True, slots=True)
class CalibrationPoint:
    """Known mass in kg and its reading in counts, with standard uncertainties."""

    mass: float  # 0 for the empty belt
    reading: float
    reading_uncertainty: float
    mass_uncertainty: float = 0.0


@dataclass(frozen=True, slots=True)
class StaticCalibration:
    """Zero in counts and sensitivity in counts/kg, with standard uncertainties and residuals."""

    zero_counts: float
    counts_per_kg: float
    zero_uncertainty: float
    counts_per_kg_uncertainty: float  # NaN if only the empty belt was read
    residuals: tuple[float, ...]  # calibrated mass minus true mass of each point in kg

    @property
    def largest_residual(self) -> float:
        """Largest absolute residual in kg."""
        return max(map(abs, self.residuals))


def calibrate(points: Sequence[CalibrationPoint]) -> StaticCalibration:
    """Fit zero and sensitivity to points with at least two different masses.

    Raises CalibrationError if a value is not finite, if an uncertainty is negative, or if the
    points do not determine zero and sensitivity.
    """
    values = np.array([astuple(point) for point in points]).reshape(-1, 4)
    masses, readings, of_readings, of_masses = values.T
    if not np.isfinite(values).all():
        raise CalibrationError('a mass, reading or uncertainty is not a finite number')
    if np.any(of_readings < 0) or np.any(of_masses < 0):
        raise CalibrationError('an uncertainty is negative')
    if len(np.unique(masses)) < 2:
        raise CalibrationError('two different masses are needed; one may be the empty belt')
    of_readings = np.maximum(of_readings, _QUANTISATION)
    slope, _ = np.polyfit(masses, readings, 1)
    for _ in range(_ITERATIONS):
        sigma = np.hypot(of_readings, slope * of_masses)
        (slope, zero), covariance = np.polyfit(masses, readings, 1, w=1 / sigma, cov='unscaled')
    misfits = readings - zero - slope * masses
    freedom = max(len(points) - 2, 1)  # with two points, the residuals and `birge` are 0
    birge = math.sqrt(np.sum((misfits / sigma) ** 2) / freedom)
    slope_uncertainty, zero_uncertainty = np.sqrt(np.diag(covariance)) * max(birge, 1.0)
    if abs(slope) < _LEAST_SPAN * slope_uncertainty:
        raise CalibrationError(
            'the readings of the masses hardly differ; check that the masses rest on the belt, and '
            'check the load-cell wiring'
        )
    return StaticCalibration(
        zero_counts=float(zero),
        counts_per_kg=float(slope),
        zero_uncertainty=float(zero_uncertainty),
        counts_per_kg_uncertainty=float(slope_uncertainty),
        residuals=tuple((misfits / slope).tolist()),
    )


def zero_only(empty: CalibrationPoint, counts_per_kg: float) -> StaticCalibration:
    """Return a calibration with a new reading of the empty belt and the old sensitivity.

    The uncertainty of the sensitivity is unknown, and therefore NaN.
    """
    return StaticCalibration(
        zero_counts=empty.reading,
        counts_per_kg=counts_per_kg,
        zero_uncertainty=max(empty.reading_uncertainty, _QUANTISATION),
        counts_per_kg_uncertainty=math.nan,
        residuals=(0.0,),
    )
