r"""Autoregressive (AR) models of a disturbance, :math:`\sum_{i=0}^{p} c_i e(k-i) = w(k)`, c_0 = 1.

The coefficients c are at once the taps of the prediction-error filter, which turns the disturbance
into the white innovation w.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class AutoregressiveModels:
    """The AR models of each signal, of all orders 0 to p.

    Attributes
    ----------
    coefficients : ndarray, (..., p + 1, p + 1) float64
        Row m is the model of order m, from the leading 1 on, zero beyond m.
    powers : ndarray, (..., p + 1) float64
        Prediction error power of each order.
    reflections : ndarray, (..., p) float64
        Reflection coefficients, each within -1..1: the last coefficient of each order.
    """

    coefficients: NDArray[np.float64]
    powers: NDArray[np.float64]
    reflections: NDArray[np.float64]

    def of_order(self, orders: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the coefficients of one order (...,) per signal: (..., p + 1), zero padded."""
        index = np.asarray(orders)[..., None, None]
        return np.take_along_axis(self.coefficients, index, axis=-2)[..., 0, :]


def burg(signal: NDArray[np.float64], max_order: int) -> AutoregressiveModels:
    """Fit AR models of all orders by Burg's method, see `burg_reflections`.

    Parameters
    ----------
    signal : ndarray, (..., n) float64
        Without its mean, time on the last axis.
    max_order : int
        p, 0 to n - 1.

    Returns
    -------
    AutoregressiveModels

    Raises
    ------
    ValueError
        If `max_order` does not fit the length of the signal.
    """
    signal = np.asarray(signal, np.float64)
    reflections = burg_reflections(signal, max_order)
    shape = signal.shape[:-1]
    powers = np.empty((*shape, max_order + 1))
    powers[..., 0] = np.mean(signal * signal, axis=-1)
    coefficients = np.zeros((*shape, max_order + 1, max_order + 1))
    coefficients[..., 0, 0] = 1
    for order in range(1, max_order + 1):
        reflection = reflections[..., order - 1]
        powers[..., order] = powers[..., order - 1] * (1 - reflection * reflection)
        coefficients[..., order, :] = coefficients[..., order - 1, :]
        _raise_order(coefficients[..., order, :], reflection, order)
    return AutoregressiveModels(coefficients, powers, reflections)


def burg_reflections(signal: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    r"""Return the reflection coefficients of Burg's method.

    It minimises the forward and the backward prediction error together:

    .. math:: k_m = -2 \frac{\sum f_{m-1}(n) b_{m-1}(n-1)}
       {\sum f_{m-1}(n)^2 + b_{m-1}(n-1)^2}

    Parameters
    ----------
    signal : ndarray, (..., n) float64
        Without its mean, time on the last axis.
    order : int
        p, 0 to n - 1.

    Returns
    -------
    ndarray, (..., p) float64
        Each within -1..1, so that the model is stable.

    Raises
    ------
    ValueError
        If `order` does not fit the length of the signal.

    References
    ----------
    J. P. Burg, Maximum entropy spectral analysis, 1975.
    """
    count, shape = signal.shape[-1], signal.shape[:-1]
    if not 0 <= order < count:
        raise ValueError(f'order {order} does not fit a signal of {count} samples')
    rows = signal.reshape(-1, count)
    # Forward errors, then backward errors one sample earlier, one after the other in memory.
    errors = np.concatenate([rows[:, 1:], rows[:, :-1]], axis=-1)
    if len(rows) == 1:
        return np.reshape(_reflections_of_one(errors[0], order), (*shape, order))
    result = np.empty((len(rows), order))
    for m in range(order):
        length = errors.shape[-1] // 2
        # As `_reflections_of_one`, to the last bit: these are the same dot products.
        energy = _dots(errors, errors)
        cross = _dots(errors[:, :length], errors[:, length:])
        reflection = -2.0 * cross / np.where(energy > 0, energy, 1.0)
        result[:, m] = reflection
        pairs = errors.reshape(-1, 2, length)
        following = pairs[:, ::-1] * reflection[:, None, None]
        following += pairs
        errors = following.reshape(-1, 2 * length)[:, 1:-1]
    return result.reshape(*shape, order)


def _dots(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    products: NDArray[np.float64] = (left[:, None, :] @ right[:, :, None])[:, 0, 0]
    return products


def _reflections_of_one(errors: NDArray[np.float64], order: int) -> list[float]:
    """Return those of one signal: most of the time goes into calls, so there are few of them."""
    result = []
    for _ in range(order):
        length = len(errors) // 2
        energy = errors.dot(errors).item()
        # What is predicted to the last bit has nothing left to reflect.
        safe = energy if energy > 0 else 1.0
        reflection = -2.0 * errors[:length].dot(errors[length:]).item() / safe
        result.append(reflection)
        pair = errors.reshape(2, length)
        following = pair[::-1] * reflection
        following += pair
        # The first forward and the last backward error have no partner in the next order.
        errors = following.reshape(-1)[1:-1]
    return result


def prediction_error_filter(reflections: NDArray[np.float64]) -> NDArray[np.float64]:
    r"""Return the coefficients of an AR model from its reflection coefficients.

    .. math:: c^{(m)} = c^{(m-1)} + k_m \tilde c^{(m-1)}

    with the order of the coefficients reversed in the last term (Levinson's recursion).

    Parameters
    ----------
    reflections : ndarray, (..., p) float64
        From order 1 on.

    Returns
    -------
    ndarray, (..., p + 1) float64
        From the leading 1 on.
    """
    order = reflections.shape[-1]
    if reflections.size == order:
        # The same sums; plain floats are faster than arrays of a few.
        taps = [1.0]
        for reflection in reflections.ravel().tolist():
            reverse = taps[::-1]
            taps.append(0.0)
            taps[1:] = [
                tap + reflection * last for tap, last in zip(taps[1:], reverse, strict=True)
            ]
        return np.reshape(taps, (*reflections.shape[:-1], order + 1))
    coefficients = np.zeros((*reflections.shape[:-1], order + 1))
    coefficients[..., 0] = 1
    for m in range(1, order + 1):
        _raise_order(coefficients, reflections[..., m - 1], m)
    return coefficients


def _raise_order(
    coefficients: NDArray[np.float64], reflection: NDArray[np.float64], order: int
) -> None:
    """Make the model of an order, in place, from that of the order before."""
    reverse = coefficients[..., order - 1 :: -1]
    coefficients[..., 1 : order + 1] += reflection[..., None] * reverse


def akaike_order(powers: NDArray[np.float64], count: int) -> Any:
    """Return the order that Akaike's information criterion n ln(power) + 2 m chooses.

    Parameters
    ----------
    powers : ndarray, (..., p + 1) float64
        Prediction error power of each order m = 0 to p, not negative.
    count : int
        Samples n that the models were fitted to.

    Returns
    -------
    ndarray, (...,) int
        The lowest of the best orders.

    References
    ----------
    H. Akaike, A new look at the statistical model identification, 1974.
    """
    # A power below what rounding leaves of the signal's is no evidence for a higher order.
    powers = np.asarray(powers)
    least = np.maximum(_ROUNDING * powers[..., :1], np.finfo(np.float64).tiny)
    orders = np.arange(powers.shape[-1])
    return np.argmin(count * np.log(np.maximum(powers, least)) + 2 * orders, axis=-1)


_ROUNDING = 1e-28
