"""Continuation of a disturbed signal beyond its ends, by linear prediction.

What shakes a belt is to a good part lines: the rollers, the motor, the platform's own oscillation.
They go on before and after the samples at hand, and an autoregressive model of these samples tells
how. Only the lowest bands of the signal are of interest, so the model is made of block means at
`PREDICTION_RATE`: so an order of few tens spans the period of a slow line.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.autoregression import burg_reflections, prediction_error_filter

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
    shape, count = disturbance.shape[:-1], disturbance.shape[-1]
    result = np.zeros((*shape, before + count + after))
    result[..., before : before + count] = disturbance
    order = min(order, count // block // _LEAST_RATIO)
    if order < 1:
        return result
    blocks = block_means(disturbance, block)
    taps = prediction_error_filter(burg_reflections(blocks, order))
    # The blocks are aligned to the end; backward they are those of the reversed signal.
    backward = block_means(disturbance[..., ::-1], block)
    steps = (before // block + 2, after // block + 2)
    free = free_response(taps, max(steps))
    preceding = predict(backward, taps, free[..., : steps[0]])
    following = predict(blocks, taps, free[..., : steps[1]])
    result[..., :before] = _interpolate(backward[..., -1:], preceding, block, before)[..., ::-1]
    result[..., before + count :] = _interpolate(blocks[..., -1:], following, block, after)
    return result


def block_means(signal: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Return the means of successive blocks; what is left over at the beginning is not used."""
    count = signal.shape[-1] // block
    used = signal[..., signal.shape[-1] - count * block :]
    blocks = used.reshape(*signal.shape[:-1], count, block)
    means: NDArray[np.float64] = np.add.reduce(blocks, axis=-1) / block
    return means


def free_response(taps: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return what a model gives after a single impulse: the series of 1 / taps.

    Parameters
    ----------
    taps : ndarray, (..., p + 1) float64
        Prediction-error filter, from the leading 1 on.
    count : int
        Number of samples, the first one is 1.

    Returns
    -------
    ndarray, (..., count) float64

    Notes
    -----
    Each step doubles the series: what the taps leave of it further on is taken out (Newton). So
    it takes few calls, where the recursion takes one for each sample.
    """
    rows = taps.reshape(-1, taps.shape[-1])
    result = np.empty((len(rows), count))
    for row, filter_taps in zip(result, rows, strict=True):
        series = np.ones(1)
        while (known := len(series)) < count:
            left = np.convolve(series, filter_taps[: 2 * known])[known : 2 * known]
            series = np.concatenate([series, -np.convolve(series, left)[:known]])
        row[:] = series[:count]
    return result.reshape(*taps.shape[:-1], count)


def predict(
    signal: NDArray[np.float64], taps: NDArray[np.float64], free: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Predict the next samples from those before and, further on, from the predicted ones.

    Parameters
    ----------
    signal : ndarray, (..., n) float64
        n at least the order p.
    taps : ndarray, (..., p + 1) float64
        Prediction-error filter, from the leading 1 on.
    free : ndarray, (..., count) float64
        Its `free_response`, as long as the prediction is to be.

    Returns
    -------
    ndarray, (..., count) float64
    """
    order, count = taps.shape[-1] - 1, free.shape[-1]
    last = signal[..., signal.shape[-1] - order :]
    result = np.empty((*signal.shape[:-1], count))
    for row, past, filter_taps, response in zip(
        result.reshape(-1, count), last.reshape(-1, order), taps.reshape(-1, order + 1),
        free.reshape(-1, count), strict=True,
    ):  # fmt: skip
        # What the past samples, alone, put into each of the next ones drives the model.
        row[:] = np.convolve(np.convolve(past, filter_taps)[order:], response)[:count]
    return -result


@lru_cache(maxsize=256)
def _places(block: int, count: int) -> tuple[NDArray[Any], ...]:
    """Return the blocks on the left and right of each sample, and the shares of both."""
    position = (np.arange(count) + 1 + (block - 1) / 2) / block
    left = position.astype(np.intp)
    share = position - left
    places = (left, left + 1, 1 - share, share)
    for values in places:
        values.flags.writeable = False
    return places


def _interpolate(
    last: NDArray[np.float64], blocks: NDArray[np.float64], block: int, count: int
) -> NDArray[np.float64]:
    """Return the samples after the end of the block `last`, linear between block centres."""
    means = np.concatenate([last, blocks], axis=-1)
    left, right, share_left, share_right = _places(block, count)
    return means.take(left, -1) * share_left + means.take(right, -1) * share_right
