# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""AID: least-squares identification behind a prefilter that is made from the window itself.

Reconstruction from the abstract of Niedzwiecki, Meller, Pietrzak, System identification based
approach to dynamic weighing revisited, Mechanical Systems and Signal Processing 80 (2016).
The platform obeys

.. math:: x(k) = -a_1 x(k-1) - a_2 x(k-2) + b_1 u(k-1) + n(k),\quad u = 1,

and least squares is at its best where n is white. So n is estimated by the residual and modelled as
an autoregression (Burg, order by Akaike). The inverse of that model, a FIR filter, makes n white
when it is applied to x and u. Least squares on the filtered signals gives better coefficients, from
which the residual and the filter are computed again. A fixed low-pass is applied, too.

The product is fully on the belt before the window begins, so an output of the filter whose taps
all lie within the window sees only u = 1. Earlier outputs are dropped. In the others, the
prefiltered u is the sum of the taps; the taps are divided by it, so u stays 1. The level of the
prefiltered signal then identifies b_1. The sum is never 0, because for a model by Burg it is the
product of 1 + k over the reflection coefficients k.

Least squares with a constant input makes the residuals sum to 0. So the mass is the mean of the
prefiltered window except for its ends, whose oscillation the coefficients remove. The effect of
the prefilter is the taper that it applies to the ends.
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
from checkweigher_dsp.signal.autoregression import akaike_order, burg
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.extended_kalman import Identification
from checkweigher_dsp.signal.platform_poles import is_stable

LEAST_SAMPLES = 8
# A Hann window of n taps (and two zeros) attenuates by 3 dB at this multiple of f_s / (n + 1).
_HANN_CUTOFF = 0.7203
_MOST_TAPS = 100_000


@dataclass(frozen=True, slots=True)
class AdaptiveSettings:
    """Settings of the prefilter."""

    # Number of identifications of the platform. The prefilter is made before each except the first,
    # so 1 means no adaptive prefilter.
    iterations: int = 5
    max_order: int = 2  # of the autoregression; never above a third of the samples
    # Hz, -3 dB, of the fixed low-pass, whose taps are a Hann window of at most half the window.
    # There is none from 0.36 times the sample rate on.
    lowpass_cutoff: float = math.inf


@dataclass(frozen=True)
class AdaptiveParameters(EstimatorParameters):
    """The prefilter."""

    iterations: tuple[float, ...] = parameter(
        (2.0,),
        'number of identifications of the platform, rounded; 1 is without a prefilter',
        minimum=1,
        maximum=20,
    )
    max_order: tuple[float, ...] = parameter(
        (2.0,), 'highest order of the prefilter, rounded', minimum=0, maximum=100
    )
    lowpass_cutoff: tuple[float, ...] = parameter(
        (480.0,),
        'cut-off of the fixed low-pass; none from 0.36 of the sample rate on',
        unit='Hz',
        minimum=1,
        maximum=1e6,
    )

    def settings(self, speed: float) -> AdaptiveSettings:
        """Return the settings at a belt speed in m/s."""
        return AdaptiveSettings(
            max(1, round(self.at('iterations', speed))),
            round(self.at('max_order', speed)),
            self.at('lowpass_cutoff', speed),
        )


@dataclass(frozen=True)
class AidParameters(AdaptiveParameters):
    """The prefilter of AID."""

    node: ClassVar[str] = 'identifier.aid'


class Aid(Estimator):
    """Adaptively prefiltered least-squares identification (reconstruction).

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
        """Return the steady state of the identified platform."""
        return self.estimate_all([window])[0]

    def estimate_all(self, windows: Sequence[WeighWindow]) -> list[LoadEstimate]:
        """Return the steady state in each window; equally long ones are identified at once."""
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
        self, samples: NDArray[np.float64], settings: Any, sample_rate: float
    ) -> 'AdaptiveIdentification':
        """Return the platform in windows (windows, n) of raw samples, kg."""
        return identify_adaptive(samples, settings, sample_rate)


@dataclass(frozen=True)
class AdaptiveIdentification(Identification):
    """Identification of each window, and whether the last iteration found stable poles.

    If it did not, the values come from the last iteration that did. If none did, `gain` and `b1`
    are the Hann-weighted mean of the window and a1 = a2 = 0.
    """

    stable: NDArray[np.bool_]

    def load_estimate(self, number: int) -> LoadEstimate:
        """Return the load in one window, with the coefficients if they are stable."""
        columns = [self.gain, self.variance]
        if self.stable[number]:
            columns += [self.a1, self.a2, self.b1]
        return LoadEstimate(*(float(column[number]) for column in columns))


def identify_adaptive(
    samples: NDArray[np.float64], settings: AdaptiveSettings, sample_rate: float
) -> AdaptiveIdentification:
    """Identify the platform by least squares on the adaptively prefiltered windows (AID).

    The mass is exact for a constant load if nothing but ringing of the platform disturbs it. Noise
    biases it a little, through the coefficients.

    Parameters
    ----------
    samples : ndarray, (windows, n) float64
        Windows t2..t3 in kg, zero removed, n at least `LEAST_SAMPLES`. Another unit scales only b1,
        mass and variance.
    settings : AdaptiveSettings
        Settings of the prefilter.
    sample_rate : float
        Hz.

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
    samples: NDArray[np.float64], settings: AdaptiveSettings, sample_rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the windows as the last iteration of `identify_adaptive` sees them.

    See `identify_adaptive` for the parameters. Returns x, (windows, m), divided by the mean of each
    window so that its level is about 1, with u = 1 throughout; this mean, (windows,) in kg, by
    which the identified steady state becomes a mass; and the variance of the least-squares residual
    of x, (windows,).
    """
    filtered, scale, _ = _prefiltered(samples, settings, sample_rate)
    # The poles of this fit may be unstable, because only its residual is used.
    fit = _least_squares(filtered)
    return filtered, scale, np.mean(_residual(filtered, fit) ** 2, axis=-1)


def prefilter(samples: NDArray[np.float64], taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the outputs of a FIR filter for which all taps lie within the window.

    Samples are (windows, n), outputs (windows, n - t + 1). The t taps are (t,) for all windows or
    (windows, t) for each; the first tap multiplies the newest sample.
    """
    count = samples.shape[-1] - taps.shape[-1] + 1
    result = np.zeros((len(samples), count))
    for lag in range(taps.shape[-1]):
        begin = taps.shape[-1] - 1 - lag
        result += taps[..., lag, None] * samples[..., begin : begin + count]
    return result


def hann_lowpass(cutoff: float, sample_rate: float) -> NDArray[np.float64]:
    """Return the taps of the fixed low-pass: a Hann window of unity gain, -3 dB at `cutoff` Hz."""
    count = max(1, round(min(_HANN_CUTOFF * sample_rate / cutoff, _MOST_TAPS)) - 1)
    taps = np.hanning(count + 2)[1:-1]
    return taps / taps.sum()


def _prefiltered(
    samples: NDArray[np.float64], settings: AdaptiveSettings, sample_rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], AdaptiveIdentification]:
    """Return the windows after the last prefilter, their means, and the previous identification.

    The windows are divided by their means, (windows,), which are NaN for a window without one.
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


def _start(x: NDArray[np.float64]) -> AdaptiveIdentification:
    """Return the initial result, which is for a platform without lag."""
    mass = hann_mean(x)
    none = 0 * mass
    # The variance of the window is large, which marks this result as a fallback.
    return AdaptiveIdentification(none, none, mass, mass, np.var(x, axis=-1), np.isinf(mass))


def _least_squares(x: NDArray[np.float64]) -> AdaptiveIdentification:
    """Fit a1, a2 and b1 with u = 1, about the means, which eliminates b1."""
    now, one, two = x[..., 2:], x[..., 1:-1], x[..., :-2]
    level0, level1, level2 = (np.mean(part, axis=-1) for part in (now, one, two))
    now, one, two = (part - np.mean(part, axis=-1, keepdims=True) for part in (now, one, two))
    s11, s22, s12 = ((a * b).sum(axis=-1) for a, b in ((one, one), (two, two), (one, two)))
    s01, s02 = (now * one).sum(axis=-1), (now * two).sum(axis=-1)
    determinant = s11 * s22 - s12 * s12
    # Without an oscillation there is nothing to fit: a1 = a2 = 0.
    inverse = 1 / np.where(determinant > 0, determinant, np.inf)
    a1 = (s12 * s02 - s22 * s01) * inverse
    a2 = (s12 * s01 - s11 * s02) * inverse
    b1 = level0 + a1 * level1 + a2 * level2
    # With stable poles 1 + a1 + a2 is positive.
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


def _residual(x: NDArray[np.float64], fit: AdaptiveIdentification) -> NDArray[np.float64]:
    """Return n of the difference equation, (windows, m - 2)."""
    response = x[:, 2:] + fit.a1[:, None] * x[:, 1:-1] + fit.a2[:, None] * x[:, :-2]
    return np.asarray(response - fit.b1[:, None])


def _whitening(residual: NDArray[np.float64], max_order: int) -> NDArray[np.float64]:
    """Return the inverse of each residual's AR model as taps of sum 1, zero padded."""
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
