"""The means of the window: what every other estimator has to beat."""

from dataclasses import dataclass
from typing import ClassVar

from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    Plateau,
    raw_plateau,
    rough_variance,
)
from checkweigher_dsp.records import WeighWindow
from checkweigher_dsp.signal.averages import hann_mean, window_mean


@dataclass(frozen=True)
class MeanParameters(EstimatorParameters):
    """The plain mean has nothing to set."""

    node: ClassVar[str] = 'identifier.mean'


@dataclass(frozen=True)
class HannParameters(EstimatorParameters):
    """The Hann-weighted mean has nothing to set."""

    node: ClassVar[str] = 'identifier.hann'


class Mean(Estimator):
    """Estimate by the mean of the raw window."""

    def estimate(self, window: WeighWindow) -> Plateau:
        """Return the mean of a window."""
        samples = raw_plateau(window)
        return Plateau(float(window_mean(samples)), rough_variance(samples))


class Hann(Estimator):
    """Estimate by the Hann-weighted mean of the raw window."""

    def estimate(self, window: WeighWindow) -> Plateau:
        """Return the Hann-weighted mean of a window."""
        samples = raw_plateau(window)
        return Plateau(float(hann_mean(samples)), rough_variance(samples))
