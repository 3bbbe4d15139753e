# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Autoregressive (AR) models of a disturbance, :math:`\sum_{i=0}^{p} c_i e(k-i) = w(k)`, c_0 = 1.

The coefficients c are also the taps of the prediction-error filter, which converts the disturbance
e to white noise, the innovation w.
"""

from collections.abc import Iterable

import numpy as np

from checkweigher_dsp.signal import Array

# The energy is summed again if it has fallen below this fraction of its last sum, because the
# recursive update has then lost three digits.
_LEFT = 1e-3


def burg(signal: Array, order: int) -> tuple[Array, Array]:
    r"""Fit an AR model by Burg's method.

    For each order m, the method minimises the sum of the squares of the forward errors f and of the
    backward errors b of the prediction:

    .. math:: k_m = -2 \frac{\sum f_{m-1}(n) b_{m-1}(n-1)}
       {\sum f_{m-1}(n)^2 + b_{m-1}(n-1)^2},\quad c^{(m)} = c^{(m-1)} + k_m \tilde c^{(m-1)}

    where the tilde reverses the order of the coefficients. All models are stable.

    Parameters
    ----------
    signal : ndarray, (n,) float64
        Signal without its mean.
    order : int
        Order p of the model, 0 to n - 1.

    Returns
    -------
    coefficients : ndarray, (p + 1,) float64
        Coefficients of the model, which begin with 1.
    reflections : ndarray, (p,) float64
        Reflection coefficients k_1 to k_p, between -1 and 1. The first m of them belong to the
        model of order m.

    Notes
    -----
    For a signal of some hundred samples, function calls take longer than the arithmetic. So the
    forward and backward errors are filtered as one matrix. An impulse is appended to each of them,
    after so many zeros that the responses to signal and impulse do not overlap. The response to the
    impulse contains the coefficients. The energy in the denominator is updated recursively: it is
    multiplied by 1 - k^2, and the squares of the two errors that are not used at the next order are
    subtracted. If this update has lost too many digits, the energy is summed again from the errors.

    References
    ----------
    J. P. Burg, Maximum entropy spectral analysis, 1975.
    N. Andersen, Comments on the performance of maximum entropy algorithms, 1978.

    Examples
    --------
    >>> coefficients, reflections = burg(np.array([1.0, 2.0, 3.0]), 1)
    >>> print(reflections.round(3), coefficients.round(3))  # -2 (1 2 + 2 3) / (1 + 4 + 4 + 9)
    [-0.889] [ 1.    -0.889]
    """
    count = len(signal)
    # The first half of the array contains the forward errors f(n), and the second half the backward
    # errors b(n - 1). In each half, the errors are followed by zeros, an impulse, and zeros.
    size = count + 2 * order
    errors = np.zeros(2 * size)
    errors[: count - 1] = signal[1:]
    errors[count + order - 1] = 1.0
    errors[size : size + count] = signal
    # Use a slice, because for order 0 the index would be out of range. The slice is then empty.
    errors[size + count + order : size + count + order + 1] = 1.0
    reflections = []
    turn = np.eye(2)
    turned = errors
    energy = least = 0.0
    for used in range(count - 1, count - 1 - order, -1):
        forward, backward = errors[:used], errors[size : size + used]
        if energy <= least:
            # Avoid a division by 0 if the signal is predicted exactly.
            energy = float(forward.dot(forward) + backward.dot(backward)) or 1.0
            least = _LEFT * energy
        reflection = -2.0 * float(forward.dot(backward)) / energy
        reflections.append(reflection)
        turn[0, 1] = turn[1, 0] = reflection
        turned = turn.dot(errors.reshape(2, size)).ravel()
        # Omit the first forward error and the last backward error, because the next order does not
        # use them.
        first, last = turned.item(0), turned.item(size + used - 1)
        energy = (1.0 - reflection * reflection) * energy - first * first - last * last
        errors = turned[1:-1]
        size -= 1
    end = len(turned) // 2
    return turned[end - order - 1 : end], np.array(reflections)


def akaike_order(powers: Array, count: int) -> int:
    """Choose the order of an AR model by Akaike's information criterion.

    The criterion of order m is n ln(power) + 2 m, for a model that was fitted to n = `count`
    samples. `powers`, (p + 1,), contains the powers of the prediction errors for the orders 0 to p.
    Of equally good orders, the lowest is chosen.

    References
    ----------
    H. Akaike, A new look at the statistical model identification, 1974.

    Examples
    --------
    >>> akaike_order(np.array([4.0, 1.0, 0.99]), 100)  # order 2 gains 1 and costs 2
    1
    """
    # Limit the powers, because a power below the rounding error is no evidence for a higher order.
    least = max(_ROUNDING * float(powers[0]), float(np.finfo(np.float64).tiny))
    criterion = count * np.log(np.maximum(powers, least)) + 2 * np.arange(len(powers))
    return int(np.argmin(criterion))


_ROUNDING = 1e-28


def pooled_autocovariance(segments: Iterable[Array], count: int) -> Array:
    """Return the biased autocovariance of segments of one process, whose mean is assumed to be 0.

    Parameters
    ----------
    segments : iterable of ndarray, (n_i,) float64
        Successive samples of each segment. A segment may be empty.
    count : int
        Number of lags, beginning with 0.

    Returns
    -------
    ndarray, (count,) float64
        Autocovariance in the squared unit of the samples. It is 0 at lags that are not smaller than
        the length of the longest segment.
    """
    sums, seen = np.zeros(count), 0
    for each in segments:
        if len(each):
            reach = min(len(each), count)
            sums[:reach] += np.correlate(each, each, 'full')[len(each) - 1 :][:reach]
            seen += len(each)
    return sums / max(seen, 1)
