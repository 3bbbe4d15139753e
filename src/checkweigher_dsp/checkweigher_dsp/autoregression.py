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
    r"""Fit AR models by Burg's method: minimise forward and backward prediction error together.

    .. math:: k_m = -2 \frac{\sum f_{m-1}(n) b_{m-1}(n-1)}
       {\sum f_{m-1}(n)^2 + b_{m-1}(n-1)^2},\quad c^{(m)} = c^{(m-1)} + k_m \tilde c^{(m-1)}

    with the order of the coefficients reversed in the last term. All models are stable.

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

    References
    ----------
    J. P. Burg, Maximum entropy spectral analysis, 1975.
    """
    signal = np.asarray(signal, np.float64)
    count, shape = signal.shape[-1], signal.shape[:-1]
    if not 0 <= max_order < count:
        raise ValueError(f'order {max_order} does not fit a signal of {count} samples')
    coefficients = np.zeros((*shape, max_order + 1, max_order + 1))
    powers = np.empty((*shape, max_order + 1))
    reflections = np.empty((*shape, max_order))
    coefficients[..., :, 0] = 1
    powers[..., 0] = np.mean(signal * signal, axis=-1)
    forward, backward = signal[..., 1:], signal[..., :-1]
    for order in range(1, max_order + 1):
        energy = np.sum(forward * forward + backward * backward, axis=-1)
        # What is predicted to the last bit has nothing left to reflect.
        safe = np.where(energy > 0, energy, 1.0)
        reflection = -2 * np.sum(forward * backward, axis=-1) / safe
        reflections[..., order - 1] = reflection
        powers[..., order] = powers[..., order - 1] * (1 - reflection * reflection)
        last, scale = coefficients[..., order - 1, :order], reflection[..., None]
        coefficients[..., order, 1:order] = last[..., 1:]
        coefficients[..., order, 1 : order + 1] += scale * last[..., ::-1]
        forward, backward = (
            (forward + scale * backward)[..., 1:],
            (backward + scale * forward)[..., :-1],
        )
    return AutoregressiveModels(coefficients, powers, reflections)


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
