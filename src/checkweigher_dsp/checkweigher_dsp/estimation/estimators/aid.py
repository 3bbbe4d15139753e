# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""AID estimator: a least-squares identification with a prefilter that adapts to the window.

This is a reconstruction from the abstract of Niedzwiecki, Meller, Pietrzak, System identification
based approach to dynamic weighing revisited, Mechanical Systems and Signal Processing 80 (2016).
The platform obeys

.. math:: x(k) = -a_1 x(k-1) - a_2 x(k-2) + b_1 u(k-1) + n(k),\quad u = 1,

and least squares is optimal if the noise n is white. So the noise n is estimated by the residual
and modelled as an autoregression (by Burg's method, with the order chosen by Akaike's criterion).
The inverse of the autoregression is a FIR filter that makes n white when it is applied to x and u.
Least squares on the filtered signals gives better coefficients, from which the residual and the
filter are computed again. A fixed low-pass filter is also applied.

The product is fully on the belt during the window, so u is 1. Outputs of the filter for which a tap
is outside the window are discarded. The taps are divided by their sum, so that the prefiltered u is
also 1. The sum of the taps is never 0, because it is the product of 1 + k over the reflection
coefficients k of a model by Burg's method.

With a constant input, the sum of the least-squares residuals is 0. So the mass is the mean of the
prefiltered window, apart from corrections for the oscillation at both ends. So the prefilter has
the same effect on the mass as a taper at both ends of the window.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, fields
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.parameters import parameter
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.estimation.estimators.base import (
    Axis,
    Estimator,
    EstimatorParameters,
    LoadEstimate,
    PlotStyle,
    raw_samples,
)
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.autoregression import akaike_order, burg
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.extended_kalman import Identification, is_stable

LEAST_SAMPLES = 8  # least number of samples in a window.
# A Hann window of n taps attenuates by 3 dB at this multiple of f_s / (n + 1).
_HANN_CUTOFF = 0.7203
_MOST_TAPS = 100_000


@dataclass(frozen=True, slots=True)
class AdaptiveSettings:
    """Settings of the prefilter of AID.

    The prefilter is computed before each identification of the platform except the first, so with
    one iteration there is no adaptive prefilter. The taps of the low-pass filter are a Hann window
    that is at most half as long as the weigh window. A cut-off of at least 0.29 times the sample
    rate has no effect.
    """

    iterations: int = 5  # number of identifications
    max_order: int = 2  # largest order of the autoregression, at most 1/3 of the number of samples
    lowpass_cutoff: float = math.inf  # -3 dB cut-off of the fixed low-pass in Hz


@dataclass(frozen=True)
class AdaptiveParameters(EstimatorParameters):
    """Parameters of the adaptive prefilter of AID and AEKSI."""

    iterations: tuple[float, ...] = parameter(
        (2.0,),
        'number of identifications of the platform, rounded; 1: no prefilter',
        minimum=1,
        maximum=20,
    )
    max_order: tuple[float, ...] = parameter(
        (2.0,), 'maximum order of the prefilter, rounded', minimum=0, maximum=100
    )
    lowpass_cutoff: tuple[float, ...] = parameter(
        (480.0,),
        'cut-off frequency (-3 dB) of the fixed low-pass filter; a value of 0.29 times the sample '
        'rate or more has no effect',
        unit='Hz',
        minimum=1,
        maximum=1e6,
    )

    def settings(self, speed: float) -> AdaptiveSettings:
        """Return the settings of the prefilter at a belt speed in m/s."""
        return AdaptiveSettings(
            max(1, round(self.at('iterations', speed))),
            round(self.at('max_order', speed)),
            self.at('lowpass_cutoff', speed),
        )


@dataclass(frozen=True)
class AidParameters(AdaptiveParameters):
    """Parameters of AID."""

    node: ClassVar[str] = 'identifier.aid'


class Aid(Estimator):
    """Least-squares identification with an adaptive prefilter (reconstruction).

    Examples
    --------
    >>> print(round(Aid(AidParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters: AdaptiveParameters = AidParameters()
    look = PlotStyle('AID', 'v', '#3aa0dc', '#6cc1f0')
    axes: ClassVar[tuple[Axis, ...]] = (
        Axis('iterations', 1, 5, 2, whole=True),
        Axis('max_order', 0, 5, 2, whole=True),
        Axis('lowpass_cutoff', 100.0, 480.0, 480.0, logarithmic=True),
    )

    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the load in a window, the steady state of the platform; see `estimate_all`."""
        return self.estimate_all([window])[0]

    def estimate_all(self, windows: Sequence[WeighWindow]) -> list[LoadEstimate]:
        """Return the load in each window, the steady state of the identified platform.

        The load is NaN for a window of fewer than `LEAST_SAMPLES` samples from t2 to t3. Windows
        with the same number of samples, settings and sample rate are processed together.
        """
        loads = [LoadEstimate(math.nan)] * len(windows)
        batches = defaultdict(list)
        for number, window in enumerate(windows):
            count = window.window_end - window.window_begin
            if count >= LEAST_SAMPLES:
                settings = self.settings(window.belt_speed)
                batches[count, settings, window.sample_rate].append(number)
        for (_, settings, sample_rate), numbers in batches.items():
            samples = np.stack([raw_samples(windows[number]) for number in numbers])
            found = self.identify(samples, settings, sample_rate)
            for row, number in enumerate(numbers):
                loads[number] = found.load_estimate(row)
        return loads

    def settings(self, speed: float) -> Any:
        """Return the settings of `identify` at a belt speed in m/s."""
        return self.parameters.settings(speed)

    def identify(
        self, samples: Array, settings: Any, sample_rate: float
    ) -> 'AdaptiveIdentification':
        """Identify the platform in windows of raw samples, (windows, n) in kg."""
        return identify_adaptive(samples, settings, sample_rate)


@dataclass(frozen=True)
class AdaptiveIdentification(Identification):
    """Identification of the platform in each window, with its stability.

    `stable`, (windows,), indicates whether the last iteration found stable poles. AID returns the
    values of the last iteration with stable poles. If no iteration finds stable poles, `gain` and
    `b1` are the Hann-weighted mean of the window, and a1 and a2 are 0.
    """

    stable: NDArray[np.bool_]

    def load_estimate(self, number: int) -> LoadEstimate:
        """Return the load in one window, with the coefficients only if the poles are stable."""
        columns = [self.gain, self.variance]
        if self.stable[number]:
            columns += [self.a1, self.a2, self.b1]
        return LoadEstimate(*(float(column[number]) for column in columns))


def identify_adaptive(
    samples: Array, settings: AdaptiveSettings, sample_rate: float
) -> AdaptiveIdentification:
    """Identify the platform by least squares on adaptively prefiltered windows (AID).

    The mass is exact for a constant load with ringing of the platform. Noise causes a small bias,
    because it affects the coefficients.

    Parameters
    ----------
    samples : ndarray, (windows, n) float64
        Windows from t2 to t3 in kg without the zero, with n at least `LEAST_SAMPLES`. With samples
        in another unit, mass and b1 are in this unit, and a1 and a2 are the same.
    settings : AdaptiveSettings
        Settings of the prefilter.
    sample_rate : float
        Sample rate in Hz.

    Examples
    --------
    >>> ringing = [0.2 + 0.01 * 0.97**k * np.cos(0.25 * k) for k in range(96)]
    >>> found = identify_adaptive(np.array([ringing]), AdaptiveSettings(), 960.0)
    >>> print(found.gain.round(9), found.a2.round(4))  # a2 is 0.97 squared
    [0.2] [0.9409]
    """
    filtered, scale, found = _prefiltered(samples, settings, sample_rate)
    return _or_before(_least_squares(filtered), found).in_unit(scale)


def prefilter_adaptively(
    samples: Array, settings: AdaptiveSettings, sample_rate: float
) -> tuple[Array, Array, Array]:
    """Return the prefiltered windows of the last iteration of `identify_adaptive`.

    See `identify_adaptive` for the parameters. Returns three arrays: the prefiltered signals,
    (windows, m), divided by the mean of each window; these means in kg, (windows,); and the
    variances of the least-squares residuals of the signals, (windows,).
    """
    filtered, scale, _ = _prefiltered(samples, settings, sample_rate)
    # Accept unstable poles, because only the residual of this fit is used.
    fit = _least_squares(filtered)
    return filtered, scale, np.mean(_residual(filtered, fit) ** 2, axis=-1)


def prefilter(samples: Array, taps: Array) -> Array:
    """Return the outputs of a FIR filter for which all taps are within the window.

    The samples are (windows, n) and the outputs (windows, n - t + 1). The taps are (t,) for all
    windows or (windows, t). The first tap multiplies the newest sample.
    """
    count = samples.shape[-1] - taps.shape[-1] + 1
    result = np.zeros((len(samples), count))
    for lag in range(taps.shape[-1]):
        begin = taps.shape[-1] - 1 - lag
        result += taps[..., lag, None] * samples[..., begin : begin + count]
    return result


def hann_lowpass(cutoff: float, sample_rate: float) -> Array:
    """Return the taps, with sum 1, of a low-pass filter with the shape of a Hann window.

    `cutoff` is the -3 dB cut-off in Hz. The actual cut-off differs slightly, because the number of
    taps is rounded. The filter has a single tap if the cut-off is at least 0.29 times the sample
    rate.
    """
    count = max(1, round(min(_HANN_CUTOFF * sample_rate / cutoff, _MOST_TAPS)) - 1)
    taps = np.hanning(count + 2)[1:-1]
    return taps / taps.sum()


def _prefiltered(
    samples: Array, settings: AdaptiveSettings, sample_rate: float
) -> tuple[Array, Array, AdaptiveIdentification]:
    """Return the prefiltered windows, the means of the raw windows, and an identification.

    The prefiltered windows, (windows, m), are divided by the means, (windows,). A mean that is 0 or
    not finite becomes NaN. The last prefilter was computed from the returned identification. With
    one iteration, there is no adaptive prefilter, and the identification is the result of `_start`.
    """
    scale = np.mean(samples, axis=-1)
    scale = np.where(np.isfinite(scale) & (scale != 0), scale, np.nan)
    x = np.where(np.isfinite(samples), samples, np.nan) / scale[:, None]
    lowpass = hann_lowpass(settings.lowpass_cutoff, sample_rate)
    longest = x.shape[-1] // 2
    if len(lowpass) > longest:
        lowpass = hann_lowpass(_HANN_CUTOFF * sample_rate / (longest + 1), sample_rate)
    base = prefilter(x, lowpass)
    filtered, found = base, _start(x)
    for _ in range(settings.iterations - 1):
        found = _or_before(_least_squares(filtered), found)
        filtered = prefilter(base, _whitening(_residual(base, found), settings.max_order))
    return filtered, scale, found


def _start(x: Array) -> AdaptiveIdentification:
    """Return the initial identification, for a platform that follows the load without delay.

    The load is the Hann-weighted mean of each window.
    """
    mass = hann_mean(x)
    none = 0 * mass
    # Use the variance of the window, because this result is only a fallback.
    return AdaptiveIdentification(none, none, mass, mass, np.var(x, axis=-1), np.isinf(mass))


def _least_squares(x: Array) -> AdaptiveIdentification:
    """Fit a1, a2 and b1 for u = 1. The means of the samples are subtracted, which eliminates b1."""
    now, one, two = x[..., 2:], x[..., 1:-1], x[..., :-2]
    level0, level1, level2 = (np.mean(part, axis=-1) for part in (now, one, two))
    now, one, two = (part - np.mean(part, axis=-1, keepdims=True) for part in (now, one, two))
    s11, s22, s12 = ((a * b).sum(axis=-1) for a, b in ((one, one), (two, two), (one, two)))
    s01, s02 = (now * one).sum(axis=-1), (now * two).sum(axis=-1)
    determinant = s11 * s22 - s12 * s12
    # Set a1 and a2 to 0 if the window contains no oscillation.
    inverse = 1 / np.where(determinant > 0, determinant, np.inf)
    a1 = (s12 * s02 - s22 * s01) * inverse
    a2 = (s12 * s01 - s11 * s02) * inverse
    b1 = level0 + a1 * level1 + a2 * level2
    # Divide by 1 + a1 + a2 only if the poles are stable, because the sum is then positive.
    stable = is_stable(a1, a2) & np.isfinite(b1)
    total = np.where(stable, 1 + a1 + a2, 1.0)
    mass = b1 / total
    count = now.shape[-1]
    residual = now + a1[:, None] * one + a2[:, None] * two
    noise = (residual * residual).sum(axis=-1) / (count - 3)
    d1, d2 = level1 - mass, level2 - mass
    spread = (d1 * d1 * s22 - 2 * d1 * d2 * s12 + d2 * d2 * s11) * inverse
    return AdaptiveIdentification(
        a1, a2, b1, mass, noise * (1 / count + spread) / total / total, stable
    )


def _residual(x: Array, fit: AdaptiveIdentification) -> Array:
    """Return the residual n of the difference equation, (windows, m - 2)."""
    response = x[:, 2:] + fit.a1[:, None] * x[:, 1:-1] + fit.a2[:, None] * x[:, :-2]
    return np.asarray(response - fit.b1[:, None])


def _whitening(residual: Array, max_order: int) -> Array:
    """Return the taps, (windows, p + 1) with sum 1, of filters that make the residuals white.

    If the filter of a window has an order below p, its taps are padded with zeros.
    """
    count = residual.shape[-1]
    max_order = min(max_order, count // 3)
    taps = np.zeros((len(residual), max_order + 1))
    for row, noise in zip(taps, residual - np.mean(residual, axis=-1, keepdims=True), strict=True):
        _, reflections = burg(noise, max_order)
        powers = np.mean(noise * noise) * np.cumprod([1.0, *(1 - reflections * reflections)])
        order = akaike_order(powers, count)
        row[: order + 1], _ = burg(noise, order)
    return taps / taps.sum(axis=-1, keepdims=True)


def _or_before(
    fit: AdaptiveIdentification, before: AdaptiveIdentification
) -> AdaptiveIdentification:
    chosen = {
        entry.name: np.where(fit.stable, getattr(fit, entry.name), getattr(before, entry.name))
        for entry in fields(fit)
    }
    return AdaptiveIdentification(**{**chosen, 'stable': fit.stable})
