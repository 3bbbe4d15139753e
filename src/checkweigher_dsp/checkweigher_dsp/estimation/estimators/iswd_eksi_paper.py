# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reference implementation of ISWD-EKSI, which follows the paper literally with errata applied.

The implementation uses PyWavelets and filterpy for one window at a time. Section and equation
numbers refer to Long et al.; docs/method.md lists the errata. The word "(open)" marks choices that
the paper does not specify. In the estimator `iswd_eksi`, the open choices are based on
measurements.
"""

from dataclasses import dataclass
from functools import partial
import math
from typing import Any, ClassVar

import numpy as np
import pywt

from checkweigher_core.parameters import parameter
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.shrinkage_table import TABLE_1
from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    LoadEstimate,
    PlotStyle,
    raw_samples,
)
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.averages import hann_mean

_WAVELET, _LEVELS = 'db16', 7
_STRETCH = 1024  # smallest length of the padded window in samples, a multiple of 128 (open)
_LEAST_NOISE = 1e-12  # smallest value of R for a signal that is scaled to a load of 1


@dataclass(frozen=True)
class IswdEksiPaperParameters(EstimatorParameters):
    """Parameters of the literal ISWD-EKSI.

    The paper does not state the values of the parameters.
    """

    node: ClassVar[str] = 'identifier.iswd_eksi_paper'

    threshold_unit: float = parameter(
        1e-7, 'unit of the thresholds in Table 1', unit='kg', minimum=0, maximum=1e3
    )
    measurement_noise: float = parameter(
        0.25,
        'measurement noise R of the Kalman filter, as a multiple of the variance that denoising '
        'removed',
        minimum=1e-9,
        maximum=1e9,
    )
    process_noise: float = parameter(
        0.01, 'process noise Q of the Kalman filter, as a multiple of R', minimum=0, maximum=1e9
    )


class IswdEksiPaper(Estimator):
    """Literal implementation of ISWD-EKSI, which denoises the raw samples from t2 to t3.

    Examples
    --------
    >>> print(round(IswdEksiPaper(IswdEksiPaperParameters()).estimate(window).mass, 4))
    0.2
    """

    parameters = IswdEksiPaperParameters()
    package = 'filterpy'
    look = PlotStyle('ISWD-EKSI, literal', 'd', '#e7a27c', '#b5653a')

    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the steady state of the identified platform, M = b1 / (1 + a1 + a2).

        The load is NaN if 1 + a1 + a2 is 0, or if the mean of the denoised samples is 0 or not
        finite.
        """
        known, samples = self.parameters, raw_samples(window)
        denoised = denoise(samples, window.belt_speed, known.threshold_unit)
        # X0 = 0 and P0 = I have no unit, so the signal is scaled to a load of 1 (errata).
        scale = float(denoised.mean())
        if not (math.isfinite(scale) and scale != 0):
            return LoadEstimate(math.nan)
        removed = float(np.var(samples - denoised)) / scale**2
        measurement = max(known.measurement_noise * removed, _LEAST_NOISE)
        found = identify(denoised / scale, measurement, known.process_noise * measurement)
        a1, a2, b1 = found.x[2:, 0]
        total = 1 + a1 + a2
        if total == 0:
            return LoadEstimate(math.nan)
        slope = np.array([-b1 / total**2, -b1 / total**2, 1 / total])
        variance = scale**2 * float(slope @ found.P[2:, 2:] @ slope)
        return LoadEstimate(
            scale * float(b1 / total), variance, float(a1), float(a2), scale * float(b1)
        )


def denoise(samples: Array, speed: float, unit: float) -> Array:
    """Denoise samples, (n,) in kg, by improved stationary wavelet denoising (section 2).

    Details 1 to 4 are set to 0. Details 5 to 7 are shrunk by the gains and thresholds of Table 1 at
    the belt speed in m/s: ``d' = sgn(d) gamma (|d| - lambda)`` if ``|d| >= lambda``, otherwise 0.
    `unit` is the unit of the thresholds in kg. The padding is the Hann-weighted mean of the samples
    (open).
    """
    length = 128 * math.ceil(max(_STRETCH, 2 * len(samples)) / 128)
    begin = (length - len(samples)) // 2
    padded = np.full(length, float(hann_mean(samples)))
    padded[begin : begin + len(samples)] = samples
    approximation, *details = pywt.swt(padded, _WAVELET, _LEVELS, trim_approx=True, norm=False)
    shrunk = []
    for detail, shrinkage in zip(details, reversed(TABLE_1.at(speed, unit)), strict=True):
        kept = np.zeros(length)
        if shrinkage is not None:
            size = np.abs(detail)
            soft = np.sign(detail) * shrinkage.gain * (size - shrinkage.threshold)
            kept = np.where(size >= shrinkage.threshold, soft, 0.0)
        shrunk.append(kept)
    denoised: Array = pywt.iswt([approximation, *shrunk], _WAVELET, norm=False)
    return denoised[begin : begin + len(samples)]


def identify(signal: Array, measurement: float, process: float) -> Any:
    """Identify the platform from a signal, (n,), by an extended Kalman filter (section 3).

    Returns the filter of filterpy, which contains the state after the last sample.

    The state is X = [x(k), x(k-1), a1, a2, b1], and u is 1 for all samples, which are between t2
    and t3. `measurement` is R, and `process` is the variance of x in Q, whose other elements are 0.
    """
    # Import filterpy only when it is used, because it loads SciPy, which is slow.
    from filterpy.kalman import ExtendedKalmanFilter

    platform = ExtendedKalmanFilter(dim_x=5, dim_z=1)  # with X0 = 0 and P0 = I
    platform.Q = np.diag([process, 0.0, 0.0, 0.0, 0.0])
    platform.R *= measurement
    platform.F[1] = [1.0, 0.0, 0.0, 0.0, 0.0]
    platform.predict_x = partial(_move_on, platform)
    for sample in signal:
        x, last, a1, a2, _ = platform.x[:, 0]
        # This is the Jacobian of equation 10 with errata applied.
        platform.F[0] = [-a1, -a2, -x, -last, 1.0]
        platform.predict()
        # This is equation 14 with errata applied.
        platform.update(np.array([[float(sample)]]), _observed, lambda state: state[:1])
    return platform


def _move_on(platform: Any, u: float = 0) -> None:
    x, last, a1, a2, b1 = platform.x[:, 0]
    platform.x = np.array([[-a1 * x - a2 * last + b1], [x], [a1], [a2], [b1]])


def _observed(_: Any) -> Array:
    return np.array([[1.0, 0.0, 0.0, 0.0, 0.0]])
