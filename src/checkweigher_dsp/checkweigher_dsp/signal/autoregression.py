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
    """Fit AR models of all orders by Burg's method, see `burg_model`.

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
    _, reflections = burg_model(signal, max_order)
    shape = signal.shape[:-1]
    coefficients = np.zeros((*shape, max_order + 1, max_order + 1))
    powers = np.empty((*shape, max_order + 1))
    coefficients[..., :, 0] = 1
    powers[..., 0] = np.mean(signal * signal, axis=-1)
    for order in range(1, max_order + 1):
        reflection = reflections[..., order - 1]
        powers[..., order] = powers[..., order - 1] * (1 - reflection * reflection)
        last = coefficients[..., order - 1, :order]
        coefficients[..., order, 1:order] = last[..., 1:]
        coefficients[..., order, 1 : order + 1] += reflection[..., None] * last[..., ::-1]
    return AutoregressiveModels(coefficients, powers, reflections)


def burg_model(
    signal: NDArray[np.float64], order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r"""Fit the AR model of one order by Burg's method.

    It minimises forward and backward prediction error together:

    .. math:: k_m = -2 \frac{\sum f_{m-1}(n) b_{m-1}(n-1)}
       {\sum f_{m-1}(n)^2 + b_{m-1}(n-1)^2},\quad c^{(m)} = c^{(m-1)} + k_m \tilde c^{(m-1)}

    with the order of the coefficients reversed in the last term. All models are stable.

    Parameters
    ----------
    signal : ndarray, (..., n) float64
        Without its mean, time on the last axis.
    order : int
        p, 0 to n - 1.

    Returns
    -------
    coefficients : ndarray, (..., p + 1) float64
        From the leading 1 on.
    reflections : ndarray, (..., p) float64
        Each within -1..1.

    Raises
    ------
    ValueError
        If `order` does not fit the length of the signal.

    Notes
    -----
    For a signal of some hundred samples the time goes into calls, not into sums. So both errors
    go through the lattice as one matrix, and behind the signal, further off than the order, an
    impulse goes with them: its response are the coefficients. The energy, which stands below the
    fraction, is that of the order before times 1 - k^2, less the squares of the two errors that
    have no partner any more; summed is it anew where rounding would show.

    References
    ----------
    J. P. Burg, Maximum entropy spectral analysis, 1975.
    N. Andersen, Comments on the performance of maximum entropy algorithms, 1978: the energy.
    """
    count, shape = signal.shape[-1], signal.shape[:-1]
    if not 0 <= order < count:
        raise ValueError(f'order {order} does not fit a signal of {count} samples')
    rows = signal.reshape(-1, count)
    # Forward errors, and backward errors one sample earlier; the last one of those has no partner.
    errors = np.zeros((len(rows), 2, count + 2 * order))
    errors[:, 0, : count - 1] = rows[:, 1:]
    errors[:, 1, :count] = rows
    errors[:, 0, count + order - 1] = 1.0
    errors[:, 1, count + order : count + order + 1] = 1.0
    if len(rows) == 1:
        coefficients, reflections = _lattice_of_one(errors[0].ravel(), count - 1, order)
    else:
        coefficients, reflections = _lattice(errors, count - 1, order)
    return coefficients.reshape(*shape, order + 1), reflections.reshape(*shape, order)


# Share of an energy that must be left for the next ones to follow from it: three digits are lost.
_LEFT = 1e-3


def _lattice(
    errors: NDArray[np.float64], count: int, order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return coefficients and reflections; `count` of the errors are those of the signals."""
    reflections = np.empty((len(errors), order))
    turn = np.tile(np.eye(2), (len(errors), 1, 1))
    turned = pairs = errors
    energy, least = np.zeros((2, len(errors)))
    for m in range(order):
        forward, backward = pairs[:, 0, : count - m], pairs[:, 1, : count - m]
        small = energy <= least
        if small.any():
            ahead, behind = forward[small], backward[small]
            summed = _dots(ahead, ahead) + _dots(behind, behind)
            # What is predicted to the last bit has nothing left to reflect.
            summed[summed == 0] = 1.0
            energy[small], least[small] = summed, _LEFT * summed
        reflection = -2.0 * _dots(forward, backward) / energy
        reflections[:, m] = turn[:, 0, 1] = turn[:, 1, 0] = reflection
        turned = turn @ pairs
        first, last = turned[:, 0, 0], turned[:, 1, count - m - 1]
        energy *= 1.0 - reflection * reflection
        energy -= first * first
        energy -= last * last
        pairs = turned.reshape(len(errors), -1)[:, 1:-1].reshape(len(errors), 2, -1)
    return turned[:, 0, turned.shape[-1] - order - 1 :], reflections


def _dots(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    products: NDArray[np.float64] = (left[:, None, :] @ right[:, :, None])[:, 0, 0]
    return products


def _lattice_of_one(
    errors: NDArray[np.float64], count: int, order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what `_lattice` does for one signal, to the last bit, in a third of the time."""
    reflections = []
    turn = np.eye(2)
    turned = flat = errors
    size = len(flat) // 2
    energy = least = 0.0
    for used in range(count, count - order, -1):
        forward, backward = flat[:used], flat[size : size + used]
        if energy <= least:
            energy = float(forward.dot(forward) + backward.dot(backward)) or 1.0
            least = _LEFT * energy
        reflection = -2.0 * float(forward.dot(backward)) / energy
        reflections.append(reflection)
        turn[0, 1] = turn[1, 0] = reflection
        turned = turn.dot(flat.reshape(2, size)).ravel()
        # The first forward and the last backward error have no partner in the next order.
        first, last = turned.item(0), turned.item(size + used - 1)
        energy = (1.0 - reflection * reflection) * energy - first * first - last * last
        flat = turned[1:-1]
        size -= 1
    end = len(turned) // 2
    return turned[end - order - 1 : end], np.array(reflections)


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
