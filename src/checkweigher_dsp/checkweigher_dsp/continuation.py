"""Continuation of a disturbed signal beyond its ends, by linear prediction.

What shakes a belt is to a good part lines: the rollers, the motor, the platform's own oscillation.
They go on before and after the samples at hand, and an autoregressive model of these samples tells
how. Only the lowest bands of the signal are of interest, so the model is made of block means at
`PREDICTION_RATE`: so an order of few tens spans the period of a slow line.
"""

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.autoregression import burg

PREDICTION_RATE = 240.0  # Hz
# Samples that a model of a given order is made from, at least, as a multiple of the order.
_LEAST_RATIO = 3


def extend(
    disturbance: NDArray[np.float64], before: int, after: int, order: int, block: int
) -> NDArray[np.float64]:
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
    ndarray, (..., before + n + after) float64
    """
    shape = disturbance.shape[:-1]
    blocks = block_means(disturbance, block)
    count = blocks.shape[-1]
    order = min(order, count // _LEAST_RATIO)
    if order < 1:
        sides = [np.zeros((*shape, number)) for number in (before, after)]
        return np.concatenate([sides[0], disturbance, sides[1]], axis=-1)
    taps = burg(blocks, order).coefficients[..., order, :]
    following = predict(blocks, taps, after // block + 2)
    # The blocks are aligned to the end; backward they are those of the reversed signal.
    backward = block_means(disturbance[..., ::-1], block)
    preceding = predict(backward, taps, before // block + 2)
    return np.concatenate(
        [
            _interpolate(backward[..., -1:], preceding, block, before)[..., ::-1],
            disturbance,
            _interpolate(blocks[..., -1:], following, block, after),
        ],
        axis=-1,
    )


def block_means(signal: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Return the means of successive blocks; what is left over at the beginning is not used."""
    count = signal.shape[-1] // block
    used = signal[..., signal.shape[-1] - count * block :]
    return np.mean(used.reshape(*signal.shape[:-1], count, block), axis=-1)


def predict(
    signal: NDArray[np.float64], taps: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Predict the next samples from those before and, further on, from the predicted ones.

    Parameters
    ----------
    signal : ndarray, (..., n) float64
        n at least the order p.
    taps : ndarray, (..., p + 1) float64
        Prediction-error filter, from the leading 1 on.
    count : int
        Number of samples to predict.

    Returns
    -------
    ndarray, (..., count) float64
    """
    order = taps.shape[-1] - 1
    result = np.empty((*signal.shape[:-1], order + count))
    result[..., :order] = signal[..., signal.shape[-1] - order :]
    weights = -taps[..., :0:-1]
    for k in range(count):
        result[..., order + k] = np.sum(weights * result[..., k : k + order], axis=-1)
    return result[..., order:]


def _interpolate(
    last: NDArray[np.float64], blocks: NDArray[np.float64], block: int, count: int
) -> NDArray[np.float64]:
    """Return the samples after the end of the block `last`, linear between block centres."""
    means = np.concatenate([last, blocks], axis=-1)
    position = (np.arange(count) + 1 + (block - 1) / 2) / block
    left = position.astype(np.intp)
    share = position - left
    return means[..., left] * (1 - share) + means[..., left + 1] * share
