# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Autoregressive (AR) models of a disturbance, :math:`\sum_{i=0}^{p} c_i e(k-i) = w(k)`, c_0 = 1.

The coefficients c are also the taps of the prediction-error filter, which turns the disturbance
into the white innovation w.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

# Least remaining share of an energy for the recursion to continue from it: three digits are lost.
_LEFT = 1e-3


def burg(
    signal: NDArray[np.float64], order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r"""Fit an AR model by Burg's method.

    It minimises forward and backward prediction errors together:

    .. math:: k_m = -2 \frac{\sum f_{m-1}(n) b_{m-1}(n-1)}
       {\sum f_{m-1}(n)^2 + b_{m-1}(n-1)^2},\quad c^{(m)} = c^{(m-1)} + k_m \tilde c^{(m-1)}

    with the order of the coefficients reversed in the last term. All models are stable.

    Parameters
    ----------
    signal : ndarray, (n,) float64
        Without its mean.
    order : int
        p, 0 to n - 1.

    Returns
    -------
    coefficients : ndarray, (p + 1,) float64
        Beginning with the leading 1.
    reflections : ndarray, (p,) float64
        k_1 to k_p, each within -1..1. The first m of them belong to the model of order m.

    Notes
    -----
    For a signal of some hundred samples, calls take longer than sums. So both errors go through the
    lattice as one matrix, followed at a distance above the order by an impulse, whose response is
    the coefficients. The energy in the denominator is that of the previous order times 1 - k^2,
    minus the squares of the two errors without a partner in the next order. If rounding would
    matter, it is summed again.

    References
    ----------
    J. P. Burg, Maximum entropy spectral analysis, 1975.
    N. Andersen, Comments on the performance of maximum entropy algorithms, 1978: the energy.

    Examples
    --------
    >>> coefficients, reflections = burg(np.array([1.0, 2.0, 3.0]), 1)
    >>> print(reflections.round(3), coefficients.round(3))  # -2 (1 2 + 2 3) / (1 + 4 + 4 + 9)
    [-0.889] [ 1.    -0.889]
    """
    count = len(signal)
    # Forward errors, then backward errors one sample earlier; each half ends with its impulse.
    size = count + 2 * order
    errors = np.zeros(2 * size)
    errors[: count - 1] = signal[1:]
    errors[count + order - 1] = 1.0
    errors[size : size + count] = signal
    errors[size + count + order : size + count + order + 1] = 1.0  # beyond the end for order 0
    reflections = []
    turn = np.eye(2)
    turned = errors
    energy = least = 0.0
    for used in range(count - 1, count - 1 - order, -1):
        forward, backward = errors[:used], errors[size : size + used]
        if energy <= least:
            # An exactly predicted signal leaves no energy.
            energy = float(forward.dot(forward) + backward.dot(backward)) or 1.0
            least = _LEFT * energy
        reflection = -2.0 * float(forward.dot(backward)) / energy
        reflections.append(reflection)
        turn[0, 1] = turn[1, 0] = reflection
        turned = turn.dot(errors.reshape(2, size)).ravel()
        # The first forward and the last backward error have no partner in the next order.
        first, last = turned.item(0), turned.item(size + used - 1)
        energy = (1.0 - reflection * reflection) * energy - first * first - last * last
        errors = turned[1:-1]
        size -= 1
    end = len(turned) // 2
    return turned[end - order - 1 : end], np.array(reflections)


def akaike_order(powers: NDArray[np.float64], count: int) -> int:
    """Choose the order of an AR model by Akaike's information criterion, n ln(power) + 2 m.

    `powers` (p + 1,) is the prediction error power of each order m = 0 to p, not negative, for
    models fitted to n = `count` samples. Of equally good orders the lowest is chosen.

    References
    ----------
    H. Akaike, A new look at the statistical model identification, 1974.

    Examples
    --------
    >>> akaike_order(np.array([4.0, 1.0, 0.99]), 100)  # the second order is worth 1, not 2
    1
    """
    # A power below the rounding error of the signal is no evidence for a higher order.
    least = max(_ROUNDING * float(powers[0]), float(np.finfo(np.float64).tiny))
    criterion = count * np.log(np.maximum(powers, least)) + 2 * np.arange(len(powers))
    return int(np.argmin(criterion))


_ROUNDING = 1e-28


def pooled_autocovariance(
    segments: Iterable[NDArray[np.float64]], count: int
) -> NDArray[np.float64]:
    """Return the biased autocovariance about zero that several segments share.

    Parameters
    ----------
    segments : iterable of ndarray, (n,) float64
        Successive samples of each segment; n may differ, and may be 0.
    count : int
        Number of lags, from 0 on.

    Returns
    -------
    ndarray, (count,) float64
        In the square of the unit of the samples; 0 at lags that no segment reaches.
    """
    sums, seen = np.zeros(count), 0
    for each in segments:
        if len(each):
            reach = min(len(each), count)
            sums[:reach] += np.correlate(each, each, 'full')[len(each) - 1 :][:reach]
            seen += len(each)
    return sums / max(seen, 1)
