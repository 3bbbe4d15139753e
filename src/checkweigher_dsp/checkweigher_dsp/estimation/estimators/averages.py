# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimators that average the raw samples of a window, as references for other estimators."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.estimation.estimators.base import Average, EstimatorParameters, PlotStyle
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.averages import hann_mean


@dataclass(frozen=True)
class MeanParameters(EstimatorParameters):
    """Parameters of the plain mean."""

    node: ClassVar[str] = 'identifier.mean'


@dataclass(frozen=True)
class HannParameters(EstimatorParameters):
    """Parameters of the Hann-weighted mean."""

    node: ClassVar[str] = 'identifier.hann'


class Mean(Average):
    """Mean of the raw samples from t2 to t3.

    The mean is unbiased for a constant load. The mean removes an oscillation that has a whole
    number of periods in the window, but not one whose period is longer than the window.

    Examples
    --------
    >>> print(round(Mean(MeanParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = MeanParameters()
    look = PlotStyle('Window mean', 's', '#8b929c', '#8b929c')

    def average(self, samples: Array, window: WeighWindow) -> float:
        """Return the mean of the samples in kg."""
        return float(np.mean(samples))


class Hann(Average):
    """Hann-weighted mean of the raw samples from t2 to t3; see `hann_mean`.

    Examples
    --------
    >>> print(round(Hann(HannParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = HannParameters()
    look = PlotStyle('Hann mean', 'D', '#4d5560', '#c4cad2')

    def average(self, samples: Array, window: WeighWindow) -> float:
        """Return the Hann-weighted mean of the samples in kg."""
        return float(hann_mean(samples))
