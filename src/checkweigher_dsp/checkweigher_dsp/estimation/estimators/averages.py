# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Means of the window, which every other estimator must beat."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.estimation.estimators.base import Average, EstimatorParameters, PlotStyle
from checkweigher_dsp.signal.averages import hann_mean


@dataclass(frozen=True)
class MeanParameters(EstimatorParameters):
    """Parameters of the plain mean, which has none of its own."""

    node: ClassVar[str] = 'identifier.mean'


@dataclass(frozen=True)
class HannParameters(EstimatorParameters):
    """Parameters of the Hann-weighted mean, which has none of its own."""

    node: ClassVar[str] = 'identifier.hann'


class Mean(Average):
    """Mean of the raw window.

    It is unbiased for a constant load. A line vanishes over whole periods, but may remain with its
    full amplitude over less than one.

    Examples
    --------
    >>> print(round(Mean(MeanParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = MeanParameters()
    look = PlotStyle('Window mean', 's', '#8b929c', '#8b929c')

    def average(self, samples: NDArray[np.float64], window: WeighWindow) -> float:
        """Return the mean."""
        return float(np.mean(samples))


class Hann(Average):
    """Hann-weighted mean of the raw window, see `hann_mean`.

    Examples
    --------
    >>> print(round(Hann(HannParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = HannParameters()
    look = PlotStyle('Hann mean', 'D', '#4d5560', '#c4cad2')

    def average(self, samples: NDArray[np.float64], window: WeighWindow) -> float:
        """Return the Hann-weighted mean."""
        return float(hann_mean(samples))
