# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Prewhitening of coloured noise, so that least-squares estimates have the smallest variance.

The noise is described by the reflection coefficients of an autoregressive model. Coefficients
between -1 and 1 always give a stable model, so they can be interpolated between two belt speeds.
The prediction-error filter of the model converts the noise to white noise. The first samples, which
have fewer predecessors than the order of the model, are predicted by the models of lower order in
the Levinson recursion. So no sample is lost. The whole filter is the exact inverse of the Cholesky
factor of the covariance matrix of the noise.
"""

from collections.abc import Sequence
import math

import numpy as np

from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.autoregression import burg


class Prewhitener:
    """Filter that converts stationary autoregressive noise to white noise of variance 1.

    Parameters
    ----------
    reflections : sequence of float, (p,)
        Reflection coefficients, each between -1 and 1.
    std_dev : float
        Standard deviation of the innovations, in the unit of the signal.

    Examples
    --------
    >>> whitener = Prewhitener([-0.5], std_dev=1.0)  # half of the previous sample, plus noise
    >>> whitener.whiten(np.array([1.0, 2.0, 3.0])).round(3).tolist()
    [0.866, 1.5, 2.0]
    """

    def __init__(self, reflections: Sequence[float] | Array, std_dev: float) -> None:
        order = len(reflections)
        self._order = order
        # Row m gives the prediction error of sample m from all samples before it, scaled to the
        # variance 1, for m below the order.
        self._start = np.zeros((order, order))
        # The variance of the prediction error of sample m is the variance of the innovations
        # divided by `remaining[m]`.
        remaining = np.cumprod((1 - np.asarray(reflections, float) ** 2)[::-1])[::-1]
        scales = np.sqrt(remaining) / std_dev
        taps = np.zeros(order + 1)
        taps[0] = 1.0
        for m, reflection in enumerate(reflections):
            reverse = taps[m::-1]
            self._start[m, : m + 1] = reverse * scales[m]
            taps[1 : m + 2] += reflection * reverse
        self._taps = taps / std_dev

    def whiten(self, signals: Array) -> Array:
        """Return the filtered signals, (..., n), whose noise has the standard deviation 1."""
        result = np.empty(signals.shape)
        begin = min(self._order, signals.shape[-1])
        result[..., :begin] = signals[..., :begin] @ self._start[:begin, :begin].T
        self.whiten_again(signals, result, begin)
        return result

    def whiten_again(self, signals: Array, whitened: Array, begin: int) -> None:
        """Update `whitened`, (..., n), after `signals`, (..., n), changed from position `begin` on.

        The samples of `signals` before position `begin` must be those from which `whitened` was
        computed.
        """
        if begin < min(self._order, signals.shape[-1]):
            whitened[:] = self.whiten(signals)
            return
        used = signals[..., begin - self._order :]
        if used.shape[-1] > self._order:
            rows = used.reshape(-1, used.shape[-1])
            filtered = [np.convolve(row, self._taps, 'valid') for row in rows]
            whitened[..., begin:] = np.reshape(filtered, (*signals.shape[:-1], -1))


def pooled_reflections(segments: Sequence[Array], order: int) -> tuple[Array, float]:
    """Fit an autoregressive model to several segments of the same noise by Burg's method.

    Each reflection coefficient is computed from the forward and backward prediction errors of all
    segments. So short segments are sufficient, and no taper is needed. A segment has the shape
    (n_i,), and its mean must be 0. Segments that are not longer than `order` are ignored. Returns
    the reflection coefficients, (order,) between -1 and 1, and the standard deviation of the
    innovations.

    Raises
    ------
    ValueError
        If the segments contain no noise, or no segment is longer than `order`.

    References
    ----------
    J. P. Burg, Maximum entropy spectral analysis, 37th Meeting of the SEG (1967).

    Examples
    --------
    >>> segments = [np.array([1.0, 2.0, 3.0]), np.array([4.0, -1.0])]
    >>> reflections, std_dev = pooled_reflections(segments, 1)
    >>> print(reflections.round(4))  # k = -2 (1 2 + 2 3 - 4 1) / (1 + 4 + 4 + 9 + 16 + 1)
    [-0.2286]
    >>> print(round(std_dev, 4))  # sqrt((1 - k k) (1 + 4 + 9 + 16 + 1) / 5)
    2.4241
    """
    kept = [np.asarray(segment, float) for segment in segments if len(segment) > order]
    if not kept:
        raise ValueError(f'no segment of noise is longer than {order} samples')
    power = float(sum(np.sum(segment**2) for segment in kept) / sum(map(len, kept)))
    if not power > 0:
        raise ValueError('the segments contain no noise')
    if len(kept) == 1:
        _, reflections = burg(kept[0], order)
        return reflections, math.sqrt(max(power * float(np.prod(1 - reflections**2)), 0.0))
    # Store all segments in one array, padded with zeros, which the mask `valid` excludes.
    longest = max(map(len, kept))
    forward = np.zeros((len(kept), longest))
    for row, segment in zip(forward, kept, strict=True):
        row[: len(segment)] = segment
    lengths = np.array([len(segment) for segment in kept])
    backward = forward.copy()
    reflections = np.zeros(order)
    for m in range(order):
        valid = np.arange(longest - m - 1) < (lengths - m - 1)[:, None]
        ahead, behind = forward[:, 1:] * valid, backward[:, :-1] * valid
        energy = np.sum(ahead**2 + behind**2)
        # Avoid a division by 0 if the signal is predicted exactly.
        reflection = -2 * np.sum(ahead * behind) / energy if energy > 0 else 0.0
        forward, backward = ahead + reflection * behind, behind + reflection * ahead
        reflections[m] = reflection
        power *= max(1 - reflection**2, 0.0)  # Rounding may give a factor below 0.
    return reflections, math.sqrt(power)
