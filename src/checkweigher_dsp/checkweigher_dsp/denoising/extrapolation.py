# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Extrapolation of a disturbance beyond the ends of a signal by linear prediction.

The disturbance of the signal consists mainly of spectral lines, caused by the rollers, the motor
and the oscillation of the platform. The spectral lines continue before and after the known samples,
so an autoregressive model of the samples predicts them. The model describes block means at the rate
`PREDICTION_RATE`, because the denoising keeps only the lowest bands of the signal. At the rate
`PREDICTION_RATE`, a model of some tens of coefficients spans the period of a slow spectral line.
"""

import numpy as np

from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.autoregression import burg

PREDICTION_RATE = 240.0  # rate of the block means in Hz
_LEAST_RATIO = 3  # minimum ratio of the number of block means to the order of the model
_PREDICTED_AT_ONCE = 4  # maximum number of samples per step of `predict`


def extrapolate(
    disturbances: Array, before: int, after: int, order: int, block: int
) -> tuple[Array, Array]:
    """Extrapolate disturbances to both sides.

    The autoregressive models are fitted by Burg's method, so they are stable, and the extrapolation
    does not grow. The same model is used forward and backward in time (own derivation).

    Parameters
    ----------
    disturbances : ndarray, (windows, n) float64
        Signals without the load in kg.
    before, after : int
        Numbers of samples to add before the first and after the last sample.
    order : int
        Order of the models. It is reduced if n is too small. With order 0, the added samples are 0.
    block : int
        Number of samples in a block.

    Returns
    -------
    extrapolated : ndarray, (windows, before + n + after) float64
        Extrapolated signals in kg.
    taps : ndarray, (windows, p + 1) float64
        Prediction-error filters of the block means, which begin with 1. The order p is 0 if the
        added samples are 0.

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
    # For the left side, use a copy of the signals that is reversed in time. Blocks are counted from
    # the end of a signal, so without the reversal there might be samples between the left end and
    # the blocks.
    means = block_means(np.stack([disturbances, disturbances[:, ::-1]], axis=1), block)
    taps = np.array([burg(signal, order)[0] for signal in means[:, 0]])
    predicted = predict(means, taps, max(before, after) // block + 2)
    samples = _between_centres(np.concatenate([means[..., -1:], predicted], axis=-1), block)
    result[:, before + count :] = samples[:, 0, :after]
    result[:, :before] = samples[:, 1, :before][:, ::-1]
    return result, taps


def block_means(signal: Array, block: int) -> Array:
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


def predict(signals: Array, taps: Array, count: int) -> Array:
    """Predict the next `count` samples of each signal.

    `signals`, (windows, m, n), contains m signals for each window, to which the same model applies.
    `taps`, (windows, p + 1), are the prediction-error filters of the models, whose first tap is 1.
    The order p is at most n. The result has the shape (windows, m, count).

    Notes
    -----
    Each step predicts a few samples as weighted sums of the p samples before them. A single step
    for all samples would be inaccurate, because the impulse response of a model of spectral lines
    grows far beyond the signal before it decays. Rounding errors would then hide the result.

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
    # Each row contains the samples of all m signals at one time, so that the samples of a step are
    # contiguous in memory.
    result = np.empty((windows, order + -(-count // width) * width, signals.shape[1]))
    result[:, :order] = signals[..., signals.shape[-1] - order :].swapaxes(1, 2)
    for k in range(order, result.shape[1], width):
        np.matmul(weights, result[:, k - order : k], out=result[:, k : k + width])
    return result[:, order : order + count].swapaxes(1, 2)


def _twice_as_far(weights: Array) -> Array:
    """Return the weights (windows, 2 n, p) that predict 2 n samples from the last p samples.

    The given weights (windows, n, p) predict n samples. The second half of the 2 n samples is
    predicted by the same weights from the last p - n samples and the n predicted samples of the
    first half.
    """
    width, order = weights.shape[1:]
    further = weights[..., order - width :] @ weights
    further[..., width:] += weights[..., : order - width]
    return np.concatenate([weights, further], axis=1)


def _between_centres(means: Array, block: int) -> Array:
    """Return the samples after the first block, interpolated linearly between block centres.

    The values at the centres are `means`, (..., blocks). The result ends with the last sample
    before the last centre.
    """
    # Distances of the samples from the block centre before them, as fractions of the distance
    # between two centres. The centre of a block with an even number of samples is between two
    # samples.
    share = (np.arange(block) + (block - 1) / 2 % 1) / block
    samples = means[..., :-1, np.newaxis] + np.diff(means)[..., np.newaxis] * share
    return samples.reshape(*means.shape[:-1], -1)[..., 1 + (block - 1) // 2 :]
