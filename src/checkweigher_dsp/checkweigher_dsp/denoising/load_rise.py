r"""The load on the belt while a product enters: its share, and what the platform makes of it.

Between t1 and t2 a product moves onto the belt at constant speed, so the share of it that rests
there rises linearly from 0 to 1. The platform of the method answers to that rise with its ringing.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def load_share(time: NDArray[np.float64], rise_time: Any) -> NDArray[np.float64]:
    """Return the share of a product that rests on the belt.

    Parameters
    ----------
    time : ndarray, (..., n) float64
        Since t1, s.
    rise_time : float or ndarray, (..., 1)
        t2 - t1, s; where it is not positive the load is there at once.

    Returns
    -------
    ndarray, (..., n) float64
        0 up to t1, 1 from t2 on.
    """
    share: NDArray[np.float64] = time / np.maximum(rise_time, _AT_ONCE)
    np.maximum(share, 0.0, out=share)
    return np.minimum(share, 1.0, out=share)


_AT_ONCE = 1e-9  # s


def load_response(
    time: NDArray[np.float64], rise_time: Any, natural_frequency: Any, damping_ratio: Any
) -> NDArray[np.float64]:
    r"""Return what a platform at rest reads of a product that enters, relative to its mass.

    The platform is :math:`\ddot y = \omega^2 (f - y) - 2 \xi \omega \dot y`; to a load that rises
    by 1 each second from time 0 on it answers with

    .. math:: r(t) = t - \frac{2 \xi}{\omega} - \frac{1}{\omega_d} e^{-\xi \omega t}
       \sin(\omega_d t - 2 \arcsin \xi),\quad \omega_d = \omega \sqrt{1 - \xi^2}

    and to a rise that ends after D with (r(t) - r(t - D)) / D.

    Parameters
    ----------
    time : ndarray, (..., n) float64
        Since t1, s, ascending.
    rise_time : float or ndarray, (..., 1)
        D = t2 - t1, s.
    natural_frequency : float or ndarray, (..., 1)
        Hz.
    damping_ratio : float or ndarray, (..., 1)
        xi, below 1.

    Returns
    -------
    ndarray, (..., n) float64
        0 up to t1, about 1 from t2 on.
    """
    rise_time = np.maximum(rise_time, _AT_ONCE)
    omega = 2 * np.pi * natural_frequency
    damped = omega * np.sqrt(1 - damping_ratio * damping_ratio)
    angle = 2 * np.arcsin(damping_ratio)
    first, full = _first_column(time, 0.0), _first_column(time, rise_time)
    # What its begin begins the end of a rise takes off again: both in one go. In place, for large
    # arrays take longer to get than to fill.
    begun = time.shape[-1] - first
    since = np.empty((*time.shape[:-1], begun + time.shape[-1] - full))
    since[..., :begun] = time[..., first:]
    np.subtract(time[..., full:], rise_time, out=since[..., begun:])
    np.maximum(since, 0.0, out=since)
    swing = damped * since
    swing -= angle
    np.sin(swing, out=swing)
    decay = -damping_ratio * omega * since
    swing *= np.exp(decay, out=decay)
    swing /= damped
    since -= np.sin(angle) / damped  # 2 xi / omega, and exactly what the swing is at 0
    since -= swing
    response = np.zeros(time.shape)
    response[..., first:] = since[..., :begun]
    response[..., full:] -= since[..., begun:]
    response /= rise_time
    return response


def _first_column(time: NDArray[np.float64], start: Any) -> int:
    """Return the first column in which any pass has come to `start`; `time` (..., n) ascends."""
    if time.ndim == 1:
        return int(time.searchsorted(start))
    return int(np.count_nonzero((time < start).reshape(-1, time.shape[-1]).all(axis=0)))


def block_responses(
    time: NDArray[np.float64], rise_time: Any, natural_frequency: Any, damping_ratio: Any
) -> NDArray[np.float64]:
    r"""Return the means of a response between successive times, and how they go with t1 and t2.

    With the pole :math:`p = -\xi \omega + i \omega_d` and
    :math:`q = 1 - i \xi \omega / \omega_d` what `load_response` is made of and its integral are

    .. math:: r(t) = t - \Re \frac{q}{p} (e^{p t} - 1),\quad
       \int_0^t r = \frac{t^2}{2} + t\, \Re \frac{q}{p} - \Re \frac{q}{p^2} (e^{p t} - 1)

    Parameters
    ----------
    time : ndarray, (..., n + 1) float64
        Since t1, s, at equal intervals: where one block ends and the next one begins.
    rise_time : float or ndarray, (..., 1)
        t2 - t1, s.
    natural_frequency : float or ndarray, (..., 1)
        Hz.
    damping_ratio : float or ndarray, (..., 1)
        xi, below 1.

    Returns
    -------
    ndarray, (3, ..., n) float64
        Mean of `load_response` in each block; its derivative to t1 with t2 as it is, 1/s; its
        derivative to t2 with t1 as it is, 1/s.
    """
    rise_time = np.maximum(rise_time, _SHORTEST)
    turn = np.sqrt(1 - np.square(damping_ratio))
    pole = 2 * np.pi * natural_frequency * (1j * turn - damping_ratio)
    first = (1 - 1j * (damping_ratio / turn)) / pole

    since = _since_both_ends(time, rise_time)
    ringing = pole * since
    np.exp(ringing, out=ringing)
    ringing -= 1
    ringing *= first
    integrals = np.empty((2, *since.shape))
    np.subtract(since, ringing.real, out=integrals[0])
    ringing /= pole
    np.multiply(since, since / 2 + first.real, out=integrals[1])
    integrals[1] -= ringing.real
    climb, area = (integrals[..., 1:] - integrals[..., :-1]) / (time[..., 1:2] - time[..., :1])
    result = np.empty((3, *climb.shape[1:]))
    response, *slopes = result
    np.subtract(area[0], area[1], out=response)
    response /= rise_time
    np.subtract(response, climb[0], out=slopes[0])
    np.subtract(climb[1], response, out=slopes[1])
    result[1:] /= rise_time
    return result


def _since_both_ends(time: NDArray[np.float64], rise_time: Any) -> NDArray[np.float64]:
    """Return the times (2, ...) since a rise began and since it ended, not below 0.

    What its begin begins its end takes off again: both in one go.
    """
    since = np.empty((2, *np.broadcast_shapes(time.shape, np.shape(rise_time))))
    since[0] = time
    np.subtract(time, rise_time, out=since[1])
    np.maximum(since, 0.0, out=since)
    return since


_SHORTEST = 1e-4  # s, of a rise whose ends are told apart: rounding leaves nothing of less
