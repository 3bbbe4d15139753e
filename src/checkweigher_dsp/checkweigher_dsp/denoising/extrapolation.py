# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Extrapolation of a disturbance beyond the ends of the signal, by linear prediction.

Most of the disturbance of a belt is lines: the rollers, the motor, the oscillation of the platform.
They continue before and after the known samples, and an autoregressive model of these samples
predicts them. Only the lowest bands of the signal matter, so block means at `PREDICTION_RATE` are
modelled, for which an order of some tens spans the period of a slow line.
"""

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal.autoregression import burg

PREDICTION_RATE = 240.0  # Hz
# Least number of block means to which a model is fitted, as a multiple of its order.
_LEAST_RATIO = 3
_PREDICTED_AT_ONCE = 4  # samples, see `predict`


def extrapolate(
    disturbances: NDArray[np.float64], before: int, after: int, order: int, block: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Continue disturbances to both sides.

    The model is fitted by Burg's method, so it is stable: the continuation decays or persists, but
    does not grow. The same model is used backward in time. [own derivation]

    Parameters
    ----------
    disturbances : ndarray, (windows, n) float64
        Signals without the load, kg.
    before, after : int
        Number of samples to put before the first and after the last one.
    order : int
        Order of the models, lowered if n is too small for it; below 1 the continuation is 0.
    block : int
        Number of samples in one block of the models.

    Returns
    -------
    extrapolated : ndarray, (windows, before + n + after) float64
        kg.
    taps : ndarray, (windows, p + 1) float64
        Prediction-error filters of the block means, beginning with the leading 1; only that 1 if
        the continuation is 0.

    Examples
    --------
    >>> line = np.sin(np.arange(0.0, 26.0, 0.065))[np.newaxis]  # 10 Hz at 960 Hz
    >>> extrapolated, _ = extrapolate(line, before=0, after=100, order=8, block=4)
    >>> print(abs(extrapolated[0, 400:] - np.sin(np.arange(26.0, 32.5, 0.065))).max() < 0.05)
    True
    """
    windows, count = disturbances.shape
    result = np.zeros((windows, before + count + after))
    result[:, before : before + count] = disturbances
    order = min(order, count // block // _LEAST_RATIO)
    if order < 1:
        return result, np.ones((windows, 1))
    # The blocks are aligned to the end from which the signal is continued.
    means = block_means(np.stack([disturbances, disturbances[:, ::-1]], axis=1), block)
    taps = np.array([burg(signal, order)[0] for signal in means[:, 0]])
    predicted = predict(means, taps, max(before, after) // block + 2)
    samples = _between_centres(np.concatenate([means[..., -1:], predicted], axis=-1), block)
    result[:, before + count :] = samples[:, 0, :after]
    result[:, :before] = samples[:, 1, :before][:, ::-1]
    return result, taps


def block_means(signal: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Return the means (..., n // block) of successive blocks of signals (..., n).

    Samples before the first full block are ignored.

    Examples
    --------
    >>> block_means(np.arange(11.0), 4).tolist()
    [4.5, 8.5]
    """
    count = signal.shape[-1] // block
    used = signal[..., signal.shape[-1] - count * block :]
    return np.asarray(used.reshape(*signal.shape[:-1], count, block).mean(axis=-1))


def predict(
    signals: NDArray[np.float64], taps: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Predict the next samples from the known ones and, further on, from predicted ones.

    Each window has m signals, (windows, m, n), with the same model, given by its prediction-error
    filter `taps`, (windows, p + 1), beginning with the leading 1. Its order p is at most n. The
    result is (windows, m, count).

    Notes
    -----
    A few samples are predicted at a time, each as a weighted sum of the last p known ones. All at
    once would not work: the impulse response of a model of lines grows far beyond the signal before
    it decays, so rounding errors would hide the result.

    Examples
    --------
    >>> halved = np.array([[[8.0, 4.0]]])
    >>> predict(halved, np.array([[1.0, -0.5]]), 3).tolist()
    [[[2.0, 1.0, 0.5]]]
    """
    order = taps.shape[-1] - 1
    weights = -taps[:, np.newaxis, :0:-1]
    while 2 * weights.shape[1] <= min(order, _PREDICTED_AT_ONCE):
        weights = _twice_as_far(weights)
    windows, width, _ = weights.shape
    # One row per time, so that the samples of a step are contiguous in memory.
    result = np.empty((windows, order + -(-count // width) * width, signals.shape[1]))
    result[:, :order] = signals[..., signals.shape[-1] - order :].swapaxes(1, 2)
    for k in range(order, result.shape[1], width):
        np.matmul(weights, result[:, k - order : k], out=result[:, k : k + width])
    return result[:, order : order + count].swapaxes(1, 2)


def _twice_as_far(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights (windows, 2 n, p) of the last p samples in the next 2 n, from those for n.

    The first half of the next 2 n samples gives n of the p samples that predict the second half.
    """
    width, order = weights.shape[1:]
    further = weights[..., order - width :] @ weights
    further[..., width:] += weights[..., : order - width]
    return np.concatenate([weights, further], axis=1)


def _between_centres(means: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Return the samples after the first block, interpolated between the block centres.

    The centres have the values `means` (..., blocks), and the last sample is at the last centre.
    """
    # The centre of a block of an even number of samples lies between two of them.
    share = (np.arange(block) + (block - 1) / 2 % 1) / block
    samples = means[..., :-1, np.newaxis] + np.diff(means)[..., np.newaxis] * share
    return samples.reshape(*means.shape[:-1], -1)[..., 1 + (block - 1) // 2 :]
