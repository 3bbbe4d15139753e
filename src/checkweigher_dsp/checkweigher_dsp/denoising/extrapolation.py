"""Continuation of a disturbed signal beyond its ends, by linear prediction.

What shakes a belt is to a good part lines: the rollers, the motor, the platform's own oscillation.
They go on before and after the samples at hand, and an autoregressive model of these samples tells
how. Only the lowest bands of the signal are of interest, so the model is made of block means at
`PREDICTION_RATE`: so an order of few tens spans the period of a slow line.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal.autoregression import burg_model

PREDICTION_RATE = 240.0  # Hz
# Samples that a model of a given order is made from, at least, as a multiple of the order.
_LEAST_RATIO = 3
_MOST_AT_ONCE = 4  # samples, see `predict`


def extend(
    disturbance: NDArray[np.float64], before: int, after: int, order: int, block: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Continue a disturbance to both sides.

    The model is fitted by Burg's method, so it is stable and the continuation dies out or goes on,
    but does not grow. Backward in time it is the same model.

    Parameters
    ----------
    disturbance : ndarray, (..., n) float64
        Without the load, time on the last axis.
    before, after : int
        Number of samples to put before the first and after the last one.
    order : int
        Of the model, lowered where n is too small for it; below 1 the continuation is 0.
    block : int
        Samples in one block of the model.

    Returns
    -------
    extended : ndarray, (..., before + n + after) float64
    taps : ndarray, (..., p + 1) float64
        Prediction-error filter of the block means, from the leading 1 on; that alone if the
        continuation is 0.
    """
    shape, count = disturbance.shape[:-1], disturbance.shape[-1]
    result = np.zeros((*shape, before + count + after))
    result[..., before : before + count] = disturbance
    order = min(order, count // block // _LEAST_RATIO)
    if order < 1:
        return result, np.ones((*shape, 1))
    # The blocks are aligned to the end; backward they are those of the reversed signal.
    means = block_means(disturbance, block)[..., None, :]
    taps, _ = burg_model(means[..., 0, :], order)
    if before:
        backward = block_means(disturbance[..., ::-1], block)[..., None, :]
        means = np.concatenate([means, backward], axis=-2)
    steps = max(before, after) // block + 2
    means = np.concatenate([means[..., -1:], predict(means, taps, steps)], axis=-1)
    result[..., before + count :] = _interpolate(means[..., 0, :], block, after)
    if before:
        result[..., :before] = _interpolate(means[..., 1, :], block, before)[..., ::-1]
    return result, taps


def block_means(signal: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Return the means of successive blocks; what is left over at the beginning is not used."""
    count = signal.shape[-1] // block
    used = signal[..., signal.shape[-1] - count * block :]
    blocks = used.reshape(*signal.shape[:-1], count, block)
    means: NDArray[np.float64] = blocks @ _share(block)
    return means


@lru_cache(maxsize=256)
def _share(block: int) -> NDArray[np.float64]:
    """Return the share of each sample of a block in its mean; the product is the fastest sum."""
    share = np.full(block, 1 / block)
    share.flags.writeable = False
    return share


def predict(
    signals: NDArray[np.float64], taps: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Predict the next samples from those before and, further on, from the predicted ones.

    Parameters
    ----------
    signals : ndarray, (..., m, n) float64
        m signals of the same model; n at least the order p.
    taps : ndarray, (..., p + 1) float64
        Prediction-error filter, from the leading 1 on.
    count : int
        Number of samples to predict.

    Returns
    -------
    ndarray, (..., m, count) float64

    Notes
    -----
    Some samples at a time, each of them written as a sum of the last p known ones. Not all at
    once: for a model of lines, whose response to an impulse grows far beyond the signal before it
    dies out, rounding would leave nothing of it.
    """
    order, number = taps.shape[-1] - 1, signals.shape[-2]
    # Time on the axis before the last one, so that what is read and written lies in one piece.
    weights = -taps[..., None, :0:-1].reshape(-1, 1, order)
    while 2 * weights.shape[-2] <= min(order, _MOST_AT_ONCE):
        weights = _twice_as_far(weights)
    width = weights.shape[-2]
    known = signals.reshape(-1, number, signals.shape[-1])[..., signals.shape[-1] - order :]
    result = np.empty((len(known), order + -(-count // width) * width, number))
    result[:, :order] = known.swapaxes(-1, -2)
    if len(result) == 1:
        _predict_lone(weights[0], result[0, :, 0] if number == 1 else result[0])
    else:
        for k in range(order, result.shape[1], width):
            np.matmul(weights, result[:, k - order : k], out=result[:, k : k + width])
    predicted = result[:, order : order + count].swapaxes(-1, -2)
    return predicted.reshape(*signals.shape[:-1], count)


def _predict_lone(weights: NDArray[np.float64], signal: NDArray[np.float64]) -> None:
    """Fill in what follows the first samples: the same products by calls that take less time."""
    width, order = weights.shape
    for k in range(order, len(signal), width):
        weights.dot(signal[k - order : k], signal[k : k + width])


def _twice_as_far(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights (..., 2 n, p) of the last p samples in the next 2 n, from those of n."""
    width, order = weights.shape[-2:]
    result = np.empty((len(weights), 2 * width, order))
    result[:, :width] = weights
    # The last n of the samples that the second half is made of are those of the first one.
    np.matmul(weights[..., order - width :], weights, out=result[:, width:])
    result[:, width:, width:] += weights[..., : order - width]
    return result


def _interpolate(means: NDArray[np.float64], block: int, count: int) -> NDArray[np.float64]:
    """Return the samples after the end of the first block, linear between block centres."""
    skipped, left, right = _shares(block)
    samples = means[..., :-1, None] * left
    samples += means[..., 1:, None] * right
    return samples.reshape(*means.shape[:-1], -1)[..., skipped : skipped + count]


@lru_cache(maxsize=256)
def _shares(block: int) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
    """Return how samples lie between block centres.

    Returns
    -------
    skipped : int
        Number of samples from the centre of a block up to its end.
    left, right : ndarray, (block,) float64
        Share of the block on either side in each sample from a centre up to the next one.
    """
    right = (np.arange(block) + (block - 1) / 2 % 1) / block
    left = 1 - right
    for values in (left, right):
        values.flags.writeable = False
    return 1 + (block - 1) // 2, left, right
