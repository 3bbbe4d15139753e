# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Denoising by shrinkage of stationary wavelet coefficients.

On a periodic signal each band of the stationary wavelet transform (SWT) is a circular convolution.
Shrinkage keeps only the approximation and three details, so the full transform is not needed. In
addition to the FFT of the signal and the inverse FFT of the result, each detail with a threshold
needs two FFTs, and a band without a threshold needs none. The results agree with ``pywt.swt`` and
``pywt.iswt`` (``norm=False``) except for rounding.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
import pywt

from checkweigher_dsp.signal import Array

WAVELET = 'db16'
LEVELS = 7


@dataclass(frozen=True, slots=True)
class Shrinkage:
    """Gain and threshold of one detail band.

    The gain gamma and the threshold lambda are floats or (windows, 1). The threshold is in the unit
    of the signal, for coefficients with the scale of ``pywt.swt(norm=False)``. A band whose
    threshold is the float 0 needs no transform.
    """

    gain: Any
    threshold: Any

    @property
    def is_linear(self) -> bool:
        """Whether the coefficients of the band are only multiplied by the gain."""
        return isinstance(self.threshold, float) and self.threshold == 0


def shrink(coefficients: Array, shrinkage: Shrinkage) -> Array:
    r"""Apply the soft threshold and the gain of a band to its coefficients.

    .. math:: d' = \operatorname{sgn}(d) \gamma (|d| - \lambda) \text{ if } |d| \ge \lambda,
       \text{ else } 0

    Examples
    --------
    >>> shrink(np.array([-5.0, -1.0, 3.0]), Shrinkage(gain=0.5, threshold=2.0)).tolist()
    [-1.5, -0.0, 0.5]
    """
    remaining = np.abs(coefficients)
    remaining -= shrinkage.threshold
    np.maximum(remaining, 0.0, out=remaining)
    remaining *= shrinkage.gain
    return np.copysign(remaining, coefficients, out=remaining)


@lru_cache(maxsize=8)
def band_responses(length: int) -> NDArray[np.complex128]:
    r"""Return the frequency responses of the SWT bands for a periodic signal of `length` samples.

    The length is a multiple of ``2**LEVELS``. The read-only result has the shape (LEVELS + 1,
    length // 2 + 1). The rows of the result belong to the details 1 to `LEVELS` and to the
    approximation. The filters of level j are the filters of level 1 with :math:`2^{j-1} - 1` zeros
    between their taps (algorithme a trous). With the Fourier transforms H of the low-pass filter
    and G of the high-pass filter of an orthogonal wavelet, the responses of the details are

    .. math:: W_{d_j}(f) = G(2^{j-1} f) \prod_{i<j} H(2^{i-1} f)

    References
    ----------
    G. P. Nason, B. W. Silverman, The stationary wavelet transform and some statistical
    applications, 1995.
    """
    filters = pywt.Wavelet(WAVELET)
    lowpass = _circular_transform(filters.dec_lo, length)
    highpass = _circular_transform(filters.dec_hi, length)
    half = np.arange(length // 2 + 1)
    approximation = np.ones(length // 2 + 1, np.complex128)
    responses = np.empty((LEVELS + 1, length // 2 + 1), np.complex128)
    for level in range(LEVELS):
        dilated = (half << level) % length
        responses[level] = approximation * highpass[dilated]
        approximation = approximation * lowpass[dilated]
    responses[LEVELS] = approximation
    responses.flags.writeable = False
    return responses


def _circular_transform(taps: Sequence[float], length: int) -> NDArray[np.complex128]:
    """Return the Fourier transform, (length,), of the taps of a filter.

    If there are more than `length` taps, the taps at the same position modulo `length` are added.
    """
    wrapped = np.zeros(length)
    np.add.at(wrapped, np.arange(len(taps)) % length, taps)
    return np.fft.fft(wrapped)


@lru_cache(maxsize=8)
def _syntheses(length: int) -> tuple[NDArray[np.complex128], Array]:
    """Return the frequency responses of the inverse SWT, and of the SWT followed by its inverse.

    Both arrays have the shape of the result of `band_responses`, with a row for each band. The
    responses of the SWT followed by its inverse are real.
    """
    responses = band_responses(length)
    # The inverse SWT averages over the 2**j shifted bases of level j, so its responses are divided
    # by powers of two.
    scales = 2.0 ** -np.array([*range(1, LEVELS + 1), LEVELS])
    syntheses = responses.conj() * scales[:, None]
    powers = (responses * syntheses).real
    syntheses.flags.writeable = powers.flags.writeable = False
    return syntheses, powers


def denoise_periodic(stretch: Array, details: Sequence[Shrinkage | None]) -> Array:
    """Denoise periodic signals by shrinkage of the detail bands.

    A band without a threshold only changes the gain at each frequency. Only the coefficients of
    bands with a threshold are computed.

    Parameters
    ----------
    stretch : ndarray, (..., n) float64
        Periodic signals, with n a multiple of ``2**LEVELS``.
    details : sequence of Shrinkage or None
        Shrinkage of each of the `LEVELS` bands. None removes a band.

    Returns
    -------
    ndarray, (..., n) float64
        Denoised signals in the unit of `stretch`.

    References
    ----------
    Long et al. (see docs/method.md), section 2: db16, 7 levels, details 1 to 4 are set to 0.

    Examples
    --------
    >>> half_a_rate = np.tile([0.9, 1.1], 64)  # 1 and an oscillation at half the sample rate
    >>> details = [None] * 4 + [Shrinkage(gain=0.5, threshold=0.0)] * 3
    >>> print(denoise_periodic(half_a_rate, details)[:3].round(6))
    [1. 1. 1.]
    """
    length = stretch.shape[-1]
    responses = band_responses(length)
    syntheses, powers = _syntheses(length)
    spectrum = np.fft.rfft(stretch)
    kept = [(band, each) for band, each in enumerate(details) if each is not None]
    gain: Any = powers[LEVELS]
    for band, shrinkage in kept:
        if shrinkage.is_linear:
            gain = gain + shrinkage.gain * powers[band]
    result = spectrum * gain
    shrunk = {band: each for band, each in kept if not each.is_linear}
    if shrunk:
        # The bands are an additional axis before the time axis.
        numbers = list(shrunk)
        bands = np.fft.irfft(spectrum[..., np.newaxis, :] * responses[numbers], length)
        for k, shrinkage in enumerate(shrunk.values()):
            bands[..., k, :] = shrink(bands[..., k, :], shrinkage)
        result += (np.fft.rfft(bands) * syntheses[numbers]).sum(axis=-2)
    return np.fft.irfft(result, length)


def threshold_universally(
    stretch: Array, *, hard: bool, measured: slice = slice(None), each_level: bool = False
) -> Array:
    r"""Denoise periodic signals by hard or soft thresholding of all details.

    This standard method is a reference for the shrinkage by `denoise_periodic`.

    The universal threshold is :math:`\lambda = \sigma \sqrt{2 \ln n}` with
    :math:`\sigma = \operatorname{med}(|d|) / 0.6745`, where d are the coefficients of a detail
    band, and n is the number of samples. Coefficients whose magnitude is below the threshold are
    set to 0. A soft threshold (STF) reduces the magnitude of the other coefficients by lambda, and
    a hard threshold (HTF) leaves them unchanged.

    The padding contains no noise, so sigma and n are determined only from the part `measured` of
    the signal. With `each_level`, sigma is computed for each level, for noise that is not white.
    Otherwise the sigma of level 1 is used for all levels. See `denoise_periodic` for `stretch` and
    for the result.

    References
    ----------
    D. L. Donoho, I. M. Johnstone, Ideal spatial adaptation by wavelet shrinkage, 1994.

    Examples
    --------
    >>> noise = 0.01 * np.random.default_rng(1).standard_normal(128)
    >>> print(f'{np.std(noise):.4f} {np.std(threshold_universally(noise, hard=False)):.4f}')
    0.0091 0.0001
    """
    length = stretch.shape[-1]
    responses = band_responses(length)
    syntheses, powers = _syntheses(length)
    spectrum = np.fft.rfft(stretch)
    result = spectrum * powers[LEVELS]
    taps = pywt.Wavelet(WAVELET).dec_len
    factor = math.sqrt(2 * math.log(max(len(range(length)[measured]), 1))) / _NORMAL_MEDIAN
    threshold: Any = 0.0
    for band in range(LEVELS):
        coefficients = np.fft.irfft(spectrum * responses[band], length)
        if each_level or band == 0:
            # Undo the delay of the causal filters of a level, because `measured` refers to the time
            # of the signal. The delay is half the total length of the filters.
            centre = taps // 2 * (2 ** (band + 1) - 1)
            centred = np.roll(coefficients, -centre, axis=-1)
            threshold = factor * np.median(np.abs(centred[..., measured]), axis=-1, keepdims=True)
        if hard:
            kept = np.where(np.abs(coefficients) >= threshold, coefficients, 0.0)
        else:
            kept = shrink(coefficients, Shrinkage(1.0, threshold))
        result += np.fft.rfft(kept) * syntheses[band]
    return np.fft.irfft(result, length)


_NORMAL_MEDIAN = 0.6745  # median of |x| for a standard normal variable x
