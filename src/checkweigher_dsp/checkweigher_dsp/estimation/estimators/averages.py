"""The means of the window, which every other estimator has to beat."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    LoadEstimate,
    raw_samples,
    rough_variance,
)
from checkweigher_dsp.records import WeighWindow
from checkweigher_dsp.signal.averages import hann_mean


@dataclass(frozen=True)
class MeanParameters(EstimatorParameters):
    """The plain mean has nothing to set."""

    node: ClassVar[str] = 'identifier.mean'


@dataclass(frozen=True)
class HannParameters(EstimatorParameters):
    """The Hann-weighted mean has nothing to set."""

    node: ClassVar[str] = 'identifier.hann'


class Mean(Estimator):
    """Estimate by the mean of the raw window.

    Unbiased for a constant load. A line vanishes over whole periods and remains with up to its
    amplitude over less than one.

    Examples
    --------
    >>> print(round(Mean(MeanParameters()).estimate(window).mass, 9))
    0.2
    """

    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the mean of a window."""
        samples = raw_samples(window)
        return LoadEstimate(float(np.mean(samples)), rough_variance(samples))


class Hann(Estimator):
    """Estimate by the Hann-weighted mean of the raw window, see `hann_mean`.

    Examples
    --------
    >>> print(round(Hann(HannParameters()).estimate(window).mass, 9))
    0.2
    """

    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the Hann-weighted mean of a window."""
        samples = raw_samples(window)
        return LoadEstimate(float(hann_mean(samples)), rough_variance(samples))
