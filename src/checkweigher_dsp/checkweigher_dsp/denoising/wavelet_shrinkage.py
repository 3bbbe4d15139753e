r"""Denoising by shrinkage of stationary wavelet coefficients.

On a periodic stretch each band of the stationary wavelet transform (SWT) is a circular
convolution, and only four bands of the method survive: the approximation and three details. So
analysis and synthesis are one FFT per band instead of the full transform, and not even that for
a band without a threshold; they agree with ``pywt.swt`` and ``pywt.iswt`` (``norm=False``) to
rounding. Many stretches can be denoised at once: time is the last axis.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
import pywt

WAVELET = 'db16'
LEVELS = 7


@dataclass(frozen=True, slots=True)
class Shrinkage:
    """Gain and threshold of one detail band.

    Attributes
    ----------
    gain : float or ndarray, (..., 1)
        gamma, 1; 0 removes the band. An array holds one value for each stretch.
    threshold : float or ndarray, (..., 1)
        lambda, in the unit of the signal as the coefficients of ``pywt.swt(norm=False)`` scale it.
    """

    gain: Any
    threshold: Any


def shrink(coefficients: NDArray[np.float64], shrinkage: Shrinkage) -> NDArray[np.float64]:
    r"""Apply the shrinkage soft threshold.

    .. math:: d' = \operatorname{sgn}(d) \gamma (|d| - \lambda) \text{ if } |d| \ge \lambda,
       \text{ else } 0

    Parameters
    ----------
    coefficients : ndarray
        Details of one band.
    shrinkage : Shrinkage
        Its gain and threshold.

    Returns
    -------
    ndarray
        Of the same shape.
    """
    remaining = np.maximum(np.abs(coefficients) - shrinkage.threshold, 0.0)
    return np.copysign(shrinkage.gain * remaining, coefficients)


@lru_cache(maxsize=64)
def band_responses(
    length: int, wavelet: str = WAVELET, levels: int = LEVELS
) -> NDArray[np.complex128]:
    r"""Return the frequency responses of the SWT bands on a circle of `length` samples.

    The filters of level j are those of level 1 with :math:`2^{j-1} - 1` zeros between their taps
    (algorithme a trous), so that with the transforms H, G of the wavelet's filters

    .. math:: W_{d_j}(f) = G(2^{j-1} f) \prod_{i<j} H(2^{i-1} f)

    Parameters
    ----------
    length : int
        A multiple of ``2**levels``.
    wavelet : str
        An orthogonal wavelet of PyWavelets.
    levels : int
        Number of levels.

    Returns
    -------
    ndarray, (levels + 1, length // 2 + 1) complex
        Details 1 to `levels`, then the approximation.

    Raises
    ------
    ValueError
        If `length` is not a multiple of ``2**levels``.

    References
    ----------
    G. P. Nason, B. W. Silverman, The stationary wavelet transform and some statistical
    applications, 1995.
    """
    if length <= 0 or length % 2**levels:
        raise ValueError(f'length {length} is not a multiple of {2**levels}')
    filters = pywt.Wavelet(wavelet)
    lowpass = _circular_transform(filters.dec_lo, length)
    highpass = _circular_transform(filters.dec_hi, length)
    half = np.arange(length // 2 + 1)
    approximation = np.ones(length // 2 + 1, np.complex128)
    responses = np.empty((levels + 1, length // 2 + 1), np.complex128)
    for level in range(levels):
        dilated = (half << level) % length
        responses[level] = approximation * highpass[dilated]
        approximation = approximation * lowpass[dilated]
    responses[levels] = approximation
    responses.flags.writeable = False
    return responses


def _circular_transform(taps: Sequence[float], length: int) -> NDArray[np.complex128]:
    """Transform of taps wrapped on a circle, which may be shorter than they are."""
    wrapped = np.zeros(length)
    np.add.at(wrapped, np.arange(len(taps)) % length, taps)
    return np.fft.fft(wrapped)


@lru_cache(maxsize=64)
def _band_powers(length: int, wavelet: str, levels: int) -> NDArray[np.float64]:
    """Return what each band adds to the gain of the whole when it is left as it is."""
    responses = band_responses(length, wavelet, levels)
    # The inverse averages the 2**j shifted bases of level j, hence the powers of two.
    scales = 2.0 ** -np.array([*range(1, levels + 1), levels])
    powers: NDArray[np.float64] = (responses.real**2 + responses.imag**2) * scales[:, None]
    powers.flags.writeable = False
    return powers


@lru_cache(maxsize=256)
def _mean_weights(
    length: int, wavelet: str, levels: int, band: int, begin: int, end: int
) -> NDArray[np.float64]:
    """Return what each sample of a stretch adds to the mean over a part of one band of it."""
    part = np.zeros(length)
    part[begin:end] = 1 / (end - begin)
    # A band is symmetric in time, so the weights are what it makes of those of the mean.
    power = _band_powers(length, wavelet, levels)[band]
    weights = np.fft.irfft(np.fft.rfft(part) * power, length)
    weights.flags.writeable = False
    return weights


class ShrinkageFilter:
    """Shrinkage of the detail bands of periodic stretches of one length.

    What a band without a threshold does is linear, so all such bands are one gain of each
    frequency; only the others have to be transformed.

    Parameters
    ----------
    length : int
        Of a stretch, a multiple of ``2**len(details)``.
    details : sequence of Shrinkage or None
        For each level from 1 on; None sets the whole band to 0.
    wavelet : str
        An orthogonal wavelet of PyWavelets.
    """

    def __init__(
        self, length: int, details: Sequence[Shrinkage | None], wavelet: str = WAVELET
    ) -> None:
        levels = len(details)
        responses = band_responses(length, wavelet, levels)
        powers = _band_powers(length, wavelet, levels)
        self._kind = length, wavelet, levels
        self._linear: list[tuple[int, Any]] = []  # bands that go through, and their gains
        shrunk: list[int] = []
        gains: list[Any] = []
        thresholds: list[Any] = []
        for number, shrinkage in enumerate(details):
            if shrinkage is None or _is_zero(shrinkage.gain):
                continue
            gain, threshold = shrinkage.gain, shrinkage.threshold
            if not _is_zero(threshold):
                shrunk.append(number)
                # A stretch has the same bits alone and beside others that do have a threshold.
                linear = np.equal(threshold, 0)
                gains.append(np.where(linear, 0.0, gain))
                thresholds.append(threshold)
                if not linear.any():
                    continue
                gain = np.where(linear, gain, 0.0)
            self._linear.append((number, gain))
        self._through = self._weighted(powers.__getitem__)
        self._shrinkage: Shrinkage | None = None
        if shrunk:
            # One more axis, that of the bands, before that of time.
            self._analysis = responses[shrunk]
            scales = 2.0 ** -(np.array(shrunk) + 1)
            self._synthesis = self._analysis.conj() * scales[:, None]
            self._shrinkage = Shrinkage(_over_bands(gains), _over_bands(thresholds))

    def apply(self, stretch: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return stretches (..., n) float64 denoised: (..., n) float64, in their unit."""
        spectrum = np.fft.rfft(stretch)
        result = spectrum * self._through
        if self._shrinkage is not None:
            bands = np.fft.irfft(spectrum[..., None, :] * self._analysis, stretch.shape[-1])
            kept = np.fft.rfft(shrink(bands, self._shrinkage))
            kept *= self._synthesis
            for band in range(len(self._analysis)):
                result += kept[..., band, :]
        return np.fft.irfft(result, stretch.shape[-1])

    def mean(self, stretch: NDArray[np.float64], part: slice) -> Any:
        """Return the mean over a part of what `apply` makes of stretches (..., n): (...,) float64.

        It is a weighted sum of the stretch and takes no transform, but only without thresholds.
        """
        if self._shrinkage is not None:
            raise ValueError('a mean without the transform: a band has a threshold')
        begin, end, _ = part.indices(stretch.shape[-1])
        weights = self._weighted(lambda band: _mean_weights(*self._kind, band, begin, end))
        return np.add.reduce(stretch * weights, axis=-1)

    def _weighted(self, of_band: Callable[[int], NDArray[np.float64]]) -> Any:
        """Return the sum of something of each band that goes through, times its gain."""
        total: Any = of_band(-1)
        for band, gain in self._linear:
            total = total + gain * of_band(band)
        return total


def _is_zero(value: Any) -> bool:
    return value == 0 if isinstance(value, float) else not np.any(value)


def _over_bands(values: Sequence[Any]) -> NDArray[np.float64]:
    """Return one value, or one (..., 1) for each stretch, of each band: (..., bands, 1)."""
    return np.stack([np.reshape(value, (*np.shape(value)[:-1], 1)) for value in
                     np.broadcast_arrays(*values)], axis=-2)  # fmt: skip


def denoise_periodic(
    stretch: NDArray[np.float64], details: Sequence[Shrinkage | None], wavelet: str = WAVELET
) -> NDArray[np.float64]:
    """Denoise a periodic stretch: shrink its detail bands, keep its approximation.

    Parameters
    ----------
    stretch : ndarray, (..., n) float64
        n a multiple of ``2**len(details)``; the end continues at the beginning.
    details : sequence of Shrinkage or None
        For each level from 1 on; None sets the whole band to 0.
    wavelet : str
        An orthogonal wavelet of PyWavelets.

    Returns
    -------
    ndarray, (..., n) float64
        In the unit of `stretch`.
    """
    return ShrinkageFilter(stretch.shape[-1], details, wavelet).apply(stretch)


def threshold_universally(
    stretch: NDArray[np.float64],
    *,
    hard: bool,
    measured: slice = slice(None),
    each_level: bool = False,
    wavelet: str = WAVELET,
    levels: int = LEVELS,
) -> NDArray[np.float64]:
    r"""Denoise by hard (HTF) or soft (STF) thresholding of all details, for comparison.

    The threshold is the universal one, :math:`\lambda = \sigma \sqrt{2 \ln n}` with
    :math:`\sigma = \operatorname{med}(|d|) / 0.6745`. A soft threshold takes lambda off what
    exceeds it, a hard one leaves it as it is.

    Parameters
    ----------
    stretch : ndarray, (..., n) float64
        As for `denoise_periodic`.
    hard : bool
        Hard or soft.
    measured : slice
        Part of the stretch whose coefficients give sigma and whose length is n: what is made up
        around it holds no noise.
    each_level : bool
        sigma from each level itself, for noise that is not white; else from level 1.
    wavelet : str
        An orthogonal wavelet of PyWavelets.
    levels : int
        Number of levels.

    Returns
    -------
    ndarray, (..., n) float64

    References
    ----------
    D. L. Donoho, I. M. Johnstone, Ideal spatial adaptation by wavelet shrinkage, 1994.
    """
    length = stretch.shape[-1]
    responses = band_responses(length, wavelet, levels)
    spectrum = np.fft.rfft(stretch)
    result = spectrum * _band_powers(length, wavelet, levels)[levels]
    taps = pywt.Wavelet(wavelet).dec_len
    factor = math.sqrt(2 * math.log(max(len(range(length)[measured]), 1))) / _NORMAL_MEDIAN
    threshold: Any = 0.0
    for level, response in enumerate(responses[:levels], start=1):
        coefficients = np.fft.irfft(spectrum * response, length)
        if each_level or level == 1:
            # The filters of a level are causal here; their middle is half their length later.
            centre = taps // 2 * (2**level - 1)
            centred = np.roll(coefficients, -centre, axis=-1)
            noise = np.median(np.abs(centred[..., measured]), axis=-1, keepdims=True)
            threshold = factor * noise
        if hard:
            kept = np.where(np.abs(coefficients) >= threshold, coefficients, 0.0)
        else:
            kept = shrink(coefficients, Shrinkage(1.0, threshold))
        result = result + np.fft.rfft(kept) * response.conj() / 2**level
    return np.fft.irfft(result, length)


_NORMAL_MEDIAN = 0.6745  # of |x| for a normal x with standard deviation 1
