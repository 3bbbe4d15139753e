# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""AEKSI estimator: the adaptive prefilter of AID and an extended Kalman filter.

The paper on ISWD-EKSI compares its results with AEKSI, but does not describe the algorithm. This
implementation is a reconstruction from AID and ISWD-EKSI.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from checkweigher_core.parameters import parameter
from checkweigher_dsp.estimation.estimators.aid import (
    AdaptiveIdentification,
    AdaptiveParameters,
    AdaptiveSettings,
    Aid,
    prefilter_adaptively,
)
from checkweigher_dsp.estimation.estimators.base import Axis, PlotStyle
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.extended_kalman import Noise, identify, is_stable


@dataclass(frozen=True)
class AeksiParameters(AdaptiveParameters):
    """Parameters of the prefilter and the Kalman filter of AEKSI."""

    node: ClassVar[str] = 'identifier.aeksi'

    measurement_noise: tuple[float, ...] = parameter(
        (1.0,),
        'measurement noise R of the Kalman filter, as a multiple of the variance of the '
        'least-squares residual',
        minimum=1e-9,
        maximum=1e9,
    )
    process_noise: tuple[float, ...] = parameter(
        (0.1,), 'process noise Q of the Kalman filter, as a multiple of R', minimum=0, maximum=1e9
    )
    coefficient_variance: tuple[float, ...] = parameter(
        (1.0,), 'initial variance P0 of a1 and a2', minimum=1e-12, maximum=1e9
    )


class Aeksi(Aid):
    """Extended Kalman identification with an adaptive prefilter (reconstruction).

    Examples
    --------
    >>> print(round(Aeksi(AeksiParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters: AeksiParameters = AeksiParameters()
    look = PlotStyle('AEKSI', 'P', '#009e73', '#2fc79a')
    axes = (
        *Aid.axes,
        Axis('measurement_noise', 1e-2, 10.0, 1.0, logarithmic=True),
        Axis('process_noise', 1e-3, 300.0, 0.1, logarithmic=True),
        Axis('coefficient_variance', 1e-6, 10.0, 1.0, logarithmic=True),
    )

    def settings(self, speed: float) -> tuple[AdaptiveSettings, Noise]:
        """Return the settings of the prefilter and the Kalman filter at a belt speed in m/s."""
        known = self.parameters
        names = 'measurement_noise', 'process_noise', 'coefficient_variance'
        return known.settings(speed), Noise(*(known.at(name, speed) for name in names))

    def identify(
        self, samples: Array, settings: tuple[AdaptiveSettings, Noise], sample_rate: float
    ) -> AdaptiveIdentification:
        """Identify the platform in windows of raw samples, (windows, n) in kg."""
        return identify_adaptive_by_ekf(samples, *settings, sample_rate)


def identify_adaptive_by_ekf(
    samples: Array, settings: AdaptiveSettings, noise: Noise, sample_rate: float
) -> AdaptiveIdentification:
    """Identify the platform by an extended Kalman filter on adaptively prefiltered windows (AEKSI).

    The filter starts from the first two samples, because with the initial state 0 it would
    attribute the whole first sample to b1. R is a multiple of the variance of the least-squares
    residual. If the poles are unstable or the result is not finite, `gain` and `b1` are the mean of
    the window, and a1 and a2 are 0. `noise` contains the settings of the Kalman filter, and
    `identify_adaptive` describes the other parameters.

    Examples
    --------
    >>> ringing = [0.2 + 0.01 * 0.97**k * np.cos(0.25 * k) for k in range(96)]
    >>> noise = Noise(measurement=1.0, process=0.1, coefficients=1.0)
    >>> found = identify_adaptive_by_ekf(np.array([ringing]), AdaptiveSettings(), noise, 960.0)
    >>> print(found.gain.round(6))
    [0.2]
    """
    filtered, scale, variance = prefilter_adaptively(samples, settings, sample_rate)
    found = identify(filtered, variance, noise, start_from_samples=True)
    stable = is_stable(found.a1, found.a2) & np.isfinite(found.gain) & np.isfinite(found.variance)
    return AdaptiveIdentification(
        np.where(stable, found.a1, 0.0),
        np.where(stable, found.a2, 0.0),
        np.where(stable, found.b1, 1.0),
        np.where(stable, found.gain, 1.0),
        np.where(stable, found.variance, np.var(filtered, axis=-1)),
        stable,
    ).in_unit(scale)
