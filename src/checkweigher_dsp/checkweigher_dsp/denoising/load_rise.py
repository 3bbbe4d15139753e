# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Load on the belt while a product enters, and the response of the platform to it.

Between t1 and t2 a product moves onto the belt at constant speed, so the fraction of the product
that is on the belt rises linearly from 0 to 1. The platform responds to the rise of the load with
ringing.
"""

from typing import Any

import numpy as np

from checkweigher_dsp.signal import Array

_SHORTEST_RISE = 1e-9  # shortest rise time in s; a step is computed as a rise of this time.
_SHORTEST_FITTED_RISE = 1e-4  # shortest rise time in s for derivatives without rounding errors


def load_share(time: Array, rise_time: Any) -> Array:
    """Return the fraction of a product on the belt, which is 0 up to t1 and 1 after t2.

    `time`, (..., n), is the time since t1 in s. `rise_time` is t2 - t1 in s; if it is not positive,
    the fraction is a step.

    Examples
    --------
    >>> load_share(np.array([-0.1, 0.0, 0.05, 0.3]), 0.1).tolist()
    [0.0, 0.0, 0.5, 1.0]
    """
    return np.clip(time / np.maximum(rise_time, _SHORTEST_RISE), 0.0, 1.0)


def load_response(time: Array, rise_time: Any, natural_frequency: Any, damping_ratio: Any) -> Array:
    r"""Return the response of a platform at rest to a product of unit mass that enters.

    The equation of the platform is :math:`\ddot y = \omega^2 (f - y) - 2 \xi \omega \dot y` for a
    load f, with the angular natural frequency omega and the damping ratio xi. The response to a
    load that rises by 1 per second from time 0 on is

    .. math:: r(t) = t - \frac{2 \xi}{\omega} - \frac{1}{\omega_d} e^{-\xi \omega t}
       \sin(\omega_d t - 2 \arcsin \xi),\quad \omega_d = \omega \sqrt{1 - \xi^2}

    and the response to a rise to 1 within the time D is (r(t) - r(t - D)) / D (own derivation).

    `time`, (..., n), is the time since t1 in s. The rise time D = t2 - t1 in s, the natural
    frequency in Hz and the damping ratio xi, below 1, are floats or (..., 1). The response is 0 up
    to t1 and about 1 after t2.

    Examples
    --------
    >>> time = np.array([0.0, 0.05, 0.1, 1.0])  # a rise of 0.1 s
    >>> load_response(time, 0.1, natural_frequency=38.0, damping_ratio=0.06).round(2).tolist()
    [0.0, 0.51, 1.0, 1.0]
    """
    rise_time = np.maximum(rise_time, _SHORTEST_RISE)
    omega = 2 * np.pi * natural_frequency
    damped = omega * np.sqrt(1 - damping_ratio * damping_ratio)
    angle = 2 * np.arcsin(damping_ratio)
    since = _since_both_ends(time, rise_time)
    swing = damped * since
    swing -= angle
    np.sin(swing, out=swing)
    swing *= np.exp(-damping_ratio * omega * since)
    swing /= damped
    since -= np.sin(angle) / damped  # This term is 2 xi / omega, and cancels the swing at time 0.
    since -= swing
    return (since[0] - since[1]) / rise_time


def block_responses(
    time: Array, rise_time: Any, natural_frequency: Any, damping_ratio: Any
) -> Array:
    r"""Return block means of `load_response`, and their derivatives with respect to t1 and t2.

    The rows of the result, (3, ..., n), are the mean of `load_response` in each block, and its
    partial derivatives with respect to t1 and t2 in 1/s. `time`, (..., n + 1), contains the bounds
    of the blocks in s since t1, at equal intervals. See `load_response` for the other parameters.

    With the pole :math:`p = -\xi \omega + i \omega_d` and :math:`q = 1 - i \xi \omega / \omega_d`
    the response r to a load that rises by 1 per second, and its integral, are (own derivation)

    .. math:: r(t) = t - \Re \frac{q}{p} (e^{p t} - 1),\quad
       \int_0^t r = \frac{t^2}{2} + t\, \Re \frac{q}{p} - \Re \frac{q}{p^2} (e^{p t} - 1)

    Examples
    --------
    >>> bounds = np.array([0.0, 0.05, 0.1, 0.15])
    >>> response, of_t1, of_t2 = block_responses(bounds, 0.1, 38.0, 0.06)
    >>> response.round(2).tolist()
    [0.24, 0.74, 1.0]
    """
    rise_time = np.maximum(rise_time, _SHORTEST_FITTED_RISE)
    turn = np.sqrt(1 - np.square(damping_ratio))
    pole = 2 * np.pi * natural_frequency * (1j * turn - damping_ratio)
    first = (1 - 1j * (damping_ratio / turn)) / pole

    since = _since_both_ends(time, rise_time)
    ringing = first * (np.exp(pole * since) - 1)
    interval = time[..., 1:2] - time[..., :1]
    climb = np.diff(since - ringing.real) / interval
    area = np.diff(since * (since / 2 + first.real) - (ringing / pole).real) / interval
    response = (area[0] - area[1]) / rise_time
    return np.stack(
        [response, (response - climb[0]) / rise_time, (climb[1] - response) / rise_time]
    )


def _since_both_ends(time: Array, rise_time: Any) -> Array:
    """Return the times in s since a rise began and since it ended, (2, ...), not below 0."""
    since = np.empty((2, *np.broadcast_shapes(time.shape, np.shape(rise_time))))
    since[0] = time
    np.subtract(time, rise_time, out=since[1])
    np.maximum(since, 0.0, out=since)
    return since
