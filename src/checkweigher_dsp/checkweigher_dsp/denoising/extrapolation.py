"""Extrapolation of a disturbance beyond the ends of the signal, by linear prediction.

Most of the disturbance of a belt is lines: the rollers, the motor, the platform's own oscillation.
They go on before and after the samples at hand, and an autoregressive model of these samples tells
how. Only the lowest bands of the signal are of interest, so the model is made of block means at
`PREDICTION_RATE`, and an order of few tens spans the period of a slow line.
"""

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal.autoregression import burg

PREDICTION_RATE = 240.0  # Hz
# Samples that a model of a given order is made from, at least, as a multiple of the order.
_LEAST_RATIO = 3
_PREDICTED_AT_ONCE = 4  # samples, see `predict`


def extrapolate(
    disturbance: NDArray[np.float64], before: int, after: int, order: int, block: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Continue a disturbance to both sides.

    The model is fitted by Burg's method, so it is stable: the continuation dies out or goes on,
    but does not grow. Backward in time it is the same model. [own derivation]

    Parameters
    ----------
    disturbance : ndarray, (n,) float64
        Signal without the load, kg.
    before, after : int
        Number of samples to put before the first and after the last one.
    order : int
        Order of the model, lowered where n is too small for it; below 1 the continuation is 0.
    block : int
        Number of samples in one block of the model.

    Returns
    -------
    extrapolated : ndarray, (before + n + after,) float64
        kg.
    taps : ndarray, (p + 1,) float64
        Prediction-error filter of the block means, from the leading 1 on; that alone if the
        continuation is 0.

    Examples
    --------
    >>> line = np.sin(np.arange(0.0, 26.0, 0.065))  # 10 Hz at 960 Hz
    >>> extrapolated, _ = extrapolate(line, before=0, after=100, order=8, block=4)
    >>> print(abs(extrapolated[400:] - np.sin(np.arange(26.0, 32.5, 0.065))).max() < 0.05)
    True
    """
    count = len(disturbance)
    result = np.zeros(before + count + after)
    result[before : before + count] = disturbance
    order = min(order, count // block // _LEAST_RATIO)
    if order < 1:
        return result, np.ones(1)
    # The blocks are aligned to the end from which the signal goes on.
    means = np.stack([block_means(disturbance, block), block_means(disturbance[::-1], block)])
    taps, _ = burg(means[0], order)
    predicted = predict(means, taps, max(before, after) // block + 2)
    forward, backward = np.concatenate([means[:, -1:], predicted], axis=-1)
    result[before + count :] = _between_blocks(forward, block, after)
    result[:before] = _between_blocks(backward, block, before)[::-1]
    return result, taps


def block_means(signal: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Return the means of successive blocks; what is left over at the beginning is not used.

    Parameters
    ----------
    signal : ndarray, (..., n) float64
        Time on the last axis.
    block : int
        Number of samples in a block.

    Returns
    -------
    ndarray, (..., n // block) float64

    Examples
    --------
    >>> block_means(np.arange(11.0), 4).tolist()
    [4.5, 8.5]
    """
    count = signal.shape[-1] // block
    used = signal[..., signal.shape[-1] - count * block :]
    means: NDArray[np.float64] = used.reshape(*signal.shape[:-1], count, block).mean(axis=-1)
    return means


def predict(
    signals: NDArray[np.float64], taps: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Predict the next samples from those before and, further on, from the predicted ones.

    Parameters
    ----------
    signals : ndarray, (m, n) float64
        m signals of the same model; n at least the order p.
    taps : ndarray, (p + 1,) float64
        Prediction-error filter, from the leading 1 on.
    count : int
        Number of samples to predict.

    Returns
    -------
    ndarray, (m, count) float64

    Notes
    -----
    Some samples at a time, each of them written as a sum of the last p known ones. Not all at
    once: for a model of lines, whose response to an impulse grows far beyond the signal before it
    dies out, rounding would leave nothing of it.

    Examples
    --------
    >>> predict(np.array([[8.0, 4.0]]), np.array([1.0, -0.5]), 3).tolist()  # halved each time
    [[2.0, 1.0, 0.5]]
    """
    order = len(taps) - 1
    weights = -taps[np.newaxis, :0:-1]
    while 2 * len(weights) <= min(order, _PREDICTED_AT_ONCE):
        weights = _twice_as_far(weights)
    width = len(weights)
    # One row a time, so that the samples which a step reads and writes lie in one piece.
    result = np.empty((order + -(-count // width) * width, len(signals)))
    result[:order] = signals[:, signals.shape[-1] - order :].T
    for k in range(order, len(result), width):
        weights.dot(result[k - order : k], result[k : k + width])
    return result[order : order + count].T


def _twice_as_far(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights (2 n, p) of the last p samples in the next 2 n, from those of n."""
    width, order = weights.shape
    # The last n of the samples that the second half is made of are those of the first one.
    further = weights[:, order - width :] @ weights
    further[:, width:] += weights[:, : order - width]
    return np.concatenate([weights, further])


def _between_blocks(means: NDArray[np.float64], block: int, count: int) -> NDArray[np.float64]:
    """Return the samples after the first block, on straight lines between block centres."""
    centres = (np.arange(len(means)) - 0.5) * block + 0.5
    return np.interp(np.arange(1, count + 1), centres, means)
