r"""Adaptive identification: a prefilter learned from the very window, then least squares.

Reconstruction from the abstract of Niedzwiecki, Meller, Pietrzak, System identification based
approach to dynamic weighing revisited, Mechanical Systems and Signal Processing 80 (2016) (AID).
The platform obeys

.. math:: x(k) = -a_1 x(k-1) - a_2 x(k-2) + b_1 u(k-1) + n(k),\quad u = 1,

and least squares is at its best where n is white. So n is taken from the residual, modelled as an
autoregression (Burg, order by Akaike) and made white by the inverse of that model, a FIR filter
that goes over x and u alike; then again, with the better coefficients. Together with it goes a
fixed low-pass.

The product is fully on the belt before the window begins, so no value of u but 1 takes part in an
output of the filter whose taps all lie within the window; the outputs before that are dropped. On
the others the prefiltered u is the sum of the taps, and with the taps divided by it u stays 1. What
then identifies b_1 is the level of the prefiltered signal. The sum is never 0: that of a model by
Burg is the product of 1 + k over its reflection coefficients k.

Least squares with a constant input lets the residuals sum to 0. So the mass is the mean of the
prefiltered window but for its ends, whose oscillation the coefficients take out: the prefilter
acts by the taper that it lays over the ends.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal.autoregression import akaike_order, burg
from checkweigher_dsp.signal.averages import hann_mean, window_mean
from checkweigher_dsp.signal.extended_kalman import Noise, Start, identify

LEAST_SAMPLES = 8
# A Hann window of n taps and its two zeros is down by 3 dB at this multiple of f_s / (n + 1).
_HANN_CUTOFF = 0.7203


@dataclass(frozen=True, slots=True)
class AdaptiveSettings:
    """How the prefilter is made.

    Attributes
    ----------
    iterations : int
        Times that the platform is identified, at least 1; before each but the first the
        prefilter is made anew, so 1 is without an adaptive prefilter.
    max_order : int
        Highest order of the autoregression, at least 0; never above a third of the samples.
    lowpass_cutoff : float
        Hz, -3 dB, of the fixed low-pass, a Hann window as taps of at most half the window. From
        0.36 times the sample rate on there is none.

    Raises
    ------
    ValueError
        If one is out of its range.
    """

    iterations: int = 5
    max_order: int = 2
    lowpass_cutoff: float = float('inf')

    def __post_init__(self) -> None:
        if self.iterations < 1 or self.max_order < 0 or not self.lowpass_cutoff > 0:
            raise ValueError(f'{self} cannot be')


@dataclass(frozen=True, slots=True)
class AdaptiveIdentification:
    """What was identified in each window; all are (...,).

    Attributes
    ----------
    a1, a2 : ndarray
        Coefficients.
    b1 : ndarray
        kg.
    mass : ndarray
        kg, b1 / (1 + a1 + a2); NaN where the mean of the window is 0 or not finite.
    variance : ndarray
        kg^2, of `mass`, to first order from the covariance of the least squares.
    stable : ndarray of bool
        Whether the last iteration found stable poles. Where not, the values are those of the last
        iteration that did; where none did, `mass` and `b1` are the Hann-weighted mean of the
        window and a1 = a2 = 0.
    """

    a1: Any
    a2: Any
    b1: Any
    mass: Any
    variance: Any
    stable: Any


@dataclass(frozen=True, slots=True)
class Prefiltered:
    """Windows behind their adaptive prefilter, for another identification (AEKSI).

    Attributes
    ----------
    samples : ndarray, (..., m) float64
        x, divided by `scale`: its level is about 1.
    inputs : ndarray, (m,) float64
        u, 1 throughout: see the head of the module.
    scale : ndarray, (...,) float64
        kg, mean of the window: the mass is the identified steady state times this.
    noise : ndarray, (...,) float64
        Variance of the least-squares residual of `samples`.
    """

    samples: NDArray[np.float64]
    inputs: NDArray[np.float64]
    scale: Any
    noise: Any


def identify_adaptive(
    samples: NDArray[np.float64], settings: AdaptiveSettings, sample_rate: float
) -> AdaptiveIdentification:
    """Identify the platform by least squares on the adaptively prefiltered windows (AID).

    Where nothing but its own ringing moves the platform the mass is exact, and so it is for a
    constant load. Noise biases it a little, through the coefficients.

    Parameters
    ----------
    samples : ndarray, (..., n) float64
        Windows t2..t3 in kg, zero removed, time on the last axis, n at least `LEAST_SAMPLES`.
        Another unit changes b1, mass and variance by it and nothing else.
    settings : AdaptiveSettings
        How the prefilter is made.
    sample_rate : float
        Hz.

    Returns
    -------
    AdaptiveIdentification

    Raises
    ------
    ValueError
        If the windows are too short.
    """
    scale, x = _normalise(samples)
    filtered, found = _iterate(x, settings, sample_rate)
    found = _or_before(_least_squares(filtered), found)
    return AdaptiveIdentification(
        found.a1,
        found.a2,
        scale * found.b1,
        scale * found.mass,
        scale * scale * found.variance,
        found.stable,
    )


def prefilter_adaptively(
    samples: NDArray[np.float64], settings: AdaptiveSettings, sample_rate: float
) -> Prefiltered:
    """Return the windows as the last iteration of `identify_adaptive` sees them.

    Parameters and errors are those of `identify_adaptive`.
    """
    scale, x = _normalise(samples)
    filtered, _ = _iterate(x, settings, sample_rate)
    # A plain fit, also where its poles are unstable: its residual is what the noise is read from.
    fit = _least_squares(filtered)
    noise = np.mean(_residual(filtered, fit) ** 2, axis=-1)
    return Prefiltered(filtered, np.ones(filtered.shape[-1]), scale, noise)


@dataclass(frozen=True, slots=True)
class FilterNoise:
    """Variances of the EKF behind the prefilter, the signal being normalised to 1.

    Attributes
    ----------
    measurement : float
        R as a multiple of the variance of the least-squares residual.
    process : float
        Q as a multiple of R.
    coefficients : float
        P0 of a1 and a2; that of b1 is 1, that of x(k) and x(k-1), which are measured, R.
    """

    measurement: float = 1.0
    process: float = 0.01
    coefficients: float = 1.0


def identify_adaptive_by_ekf(
    samples: NDArray[np.float64],
    settings: AdaptiveSettings,
    noise: FilterNoise,
    sample_rate: float,
) -> AdaptiveIdentification:
    """Identify the platform by the EKF on the adaptively prefiltered windows (AEKSI).

    The filter starts from the first two samples: from X0 = 0 the first sample would all go into
    b1. Bias and errors are those of `identify_adaptive`.

    Parameters
    ----------
    samples, settings, sample_rate
        As in `identify_adaptive`.
    noise : FilterNoise
        Variances.

    Returns
    -------
    AdaptiveIdentification
        Where the poles are unstable `mass` and `b1` are the mean of the window and a1 = a2 = 0.
    """
    behind = prefilter_adaptively(samples, settings, sample_rate)
    one = samples.ndim == 1
    relative: Any = np.maximum(noise.measurement * behind.noise, _LEAST_NOISE)
    series: Any = np.moveaxis(behind.samples, -1, 0)
    if one:  # plain floats: arithmetic on numpy's is several times slower
        relative, series = float(relative), series.tolist()
    with np.errstate(all='ignore'):
        found = identify(
            series[2:],
            Noise(noise.process * relative, relative, 1.0, noise.coefficients, relative),
            start=Start(x=series[1], x_before=series[0]),
        )
        stable = (
            (np.abs(found.a2) < 1)
            & (np.abs(found.a1) < 1 + found.a2)
            & np.isfinite(found.gain)
            & np.isfinite(found.variance)
        )
    scale = behind.scale
    return AdaptiveIdentification(
        np.where(stable, found.a1, 0.0)[()],
        np.where(stable, found.a2, 0.0)[()],
        scale * np.where(stable, found.b1, 1.0)[()],
        scale * np.where(stable, found.gain, 1.0)[()],
        scale * scale * np.where(stable, found.variance, np.var(behind.samples, axis=-1))[()],
        stable,
    )


# Relative variance that even a noise-free signal is credited with: the filter stays regular.
_LEAST_NOISE = 1e-14


def prefilter(samples: NDArray[np.float64], taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the outputs of a FIR filter all of whose taps lie within the window.

    Parameters
    ----------
    samples : ndarray, (..., n) float64
        Time on the last axis.
    taps : ndarray, (..., t) float64
        One filter for all windows, or one for each; the first tap goes with the newest sample.

    Returns
    -------
    ndarray, (..., n - t + 1) float64
    """
    count = samples.shape[-1] - taps.shape[-1] + 1
    result = np.zeros((*samples.shape[:-1], count))
    for lag in range(taps.shape[-1]):
        begin = taps.shape[-1] - 1 - lag
        result += taps[..., lag, None] * samples[..., begin : begin + count]
    return result


def hann_lowpass(cutoff: float, sample_rate: float) -> NDArray[np.float64]:
    """Return the taps of the fixed low-pass: a Hann window of unity gain, -3 dB at `cutoff` Hz."""
    count = max(1, round(min(_HANN_CUTOFF * sample_rate / cutoff, _MOST_TAPS)) - 1)
    taps = np.hanning(count + 2)[1:-1]
    return taps / taps.sum()


_MOST_TAPS = 100_000


def _normalise(samples: NDArray[np.float64]) -> tuple[Any, NDArray[np.float64]]:
    """Return the means of the windows, NaN where there is none, and the windows divided by them."""
    count = np.shape(samples)[-1]
    if count < LEAST_SAMPLES:
        raise ValueError(f'{count} samples are too few, must be at least {LEAST_SAMPLES}')
    scale = window_mean(samples)
    scale = np.where(np.isfinite(scale) & (scale != 0), scale, np.nan)[()]
    return scale, np.where(np.isfinite(samples), samples, np.nan) / _column(scale)


def _iterate(
    x: NDArray[np.float64], settings: AdaptiveSettings, sample_rate: float
) -> tuple[NDArray[np.float64], AdaptiveIdentification]:
    """Return the windows behind the last prefilter, and what was identified before it."""
    lowpass = hann_lowpass(settings.lowpass_cutoff, sample_rate)
    longest = x.shape[-1] // 2
    if len(lowpass) > longest:
        lowpass = hann_lowpass(_HANN_CUTOFF * sample_rate / (longest + 1), sample_rate)
    base = prefilter(x, lowpass)
    filtered, found = base, _start(x)
    for _ in range(settings.iterations - 1):
        found = _or_before(_least_squares(filtered), found)
        filtered = prefilter(base, _whitening(_residual(base, found), settings.max_order))
    return filtered, found


def _start(x: NDArray[np.float64]) -> AdaptiveIdentification:
    """Return what holds until stable poles are found: a platform that follows at once."""
    mass = hann_mean(x)
    none = 0 * mass
    # The scatter of the window is no small variance: it tells that this is a makeshift.
    return AdaptiveIdentification(none, none, mass, mass, np.var(x, axis=-1), np.isinf(mass))


def _least_squares(x: NDArray[np.float64]) -> AdaptiveIdentification:
    """Fit a1, a2 and b1 with u = 1, about the means: with them b1 falls out of the equations."""
    now, one, two = x[..., 2:], x[..., 1:-1], x[..., :-2]
    level0, level1, level2 = (np.mean(part, axis=-1) for part in (now, one, two))
    now, one, two = (part - np.mean(part, axis=-1, keepdims=True) for part in (now, one, two))
    s11, s22, s12 = ((a * b).sum(axis=-1) for a, b in ((one, one), (two, two), (one, two)))
    s01, s02 = (now * one).sum(axis=-1), (now * two).sum(axis=-1)
    determinant = s11 * s22 - s12 * s12
    # Where nothing oscillates there is nothing to fit: a1 = a2 = 0.
    inverse = 1 / np.where(determinant > 0, determinant, np.inf)
    a1 = (s12 * s02 - s22 * s01) * inverse
    a2 = (s12 * s01 - s11 * s02) * inverse
    b1 = level0 + a1 * level1 + a2 * level2
    # The stability triangle; within it 1 + a1 + a2 is positive.
    stable = (abs(a2) < 1) & (abs(a1) < 1 + a2) & np.isfinite(b1)
    total = np.where(stable, 1 + a1 + a2, 1.0)
    mass = b1 / total
    count = now.shape[-1]
    residual = now + _column(a1) * one + _column(a2) * two
    noise = (residual * residual).sum(axis=-1) / (count - 3)
    d1, d2 = level1 - mass, level2 - mass
    spread = (d1 * d1 * s22 - 2 * d1 * d2 * s12 + d2 * d2 * s11) * inverse
    return AdaptiveIdentification(
        a1, a2, b1, mass, noise * (1 / count + spread) / total / total, stable
    )


def _residual(x: NDArray[np.float64], fit: AdaptiveIdentification) -> NDArray[np.float64]:
    """Return n of the difference equation, (..., n - 2)."""
    rest: NDArray[np.float64] = (
        x[..., 2:] + _column(fit.a1) * x[..., 1:-1] + _column(fit.a2) * x[..., :-2]
    ) - _column(fit.b1)
    return rest


def _whitening(residual: NDArray[np.float64], max_order: int) -> NDArray[np.float64]:
    """Return the inverse of the residual's AR model as taps of sum 1, zero padded."""
    count = residual.shape[-1]
    models = burg(residual - np.mean(residual, axis=-1, keepdims=True), min(max_order, count // 3))
    taps = models.of_order(akaike_order(models.powers, count))
    return taps / taps.sum(axis=-1, keepdims=True)


def _or_before(
    fit: AdaptiveIdentification, before: AdaptiveIdentification
) -> AdaptiveIdentification:
    """Return the fit where it is stable, and what was there before where it is not."""

    def pick(new: Any, old: Any) -> Any:
        return np.where(fit.stable, new, old)[()]

    return AdaptiveIdentification(
        pick(fit.a1, before.a1),
        pick(fit.a2, before.a2),
        pick(fit.b1, before.b1),
        pick(fit.mass, before.mass),
        pick(fit.variance, before.variance),
        fit.stable,
    )


def _column(values: Any) -> NDArray[np.float64]:
    return np.expand_dims(values, -1)
