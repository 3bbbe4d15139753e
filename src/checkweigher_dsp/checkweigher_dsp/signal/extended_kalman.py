# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Identification of the weighing platform by an extended Kalman filter (EKF).

The signal x of the platform obeys :math:`x(k) = -a_1 x(k-1) - a_2 x(k-2) + b_1 u(k-1)`, where u is
the fraction of the load that is on the platform. So the load is the steady state for u = 1, which
is :math:`b_1 / (1 + a_1 + a_2)`. The filter estimates the signal and the coefficients at the same
time, in the state :math:`X = [x(k), x(k-1), a_1, a_2, b_1]`.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice, repeat
import math
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal import Array


@dataclass(frozen=True, slots=True)
class Noise:
    """Variances of the filter, for a signal whose steady state is normalised to about 1."""

    # Variance R of the measurement noise as a multiple of the argument `variance` of `identify`.
    measurement: float
    # Variance Q of the process noise of x as a multiple of R. Q of the coefficients is 0.
    process: float
    coefficients: float  # initial variance P0 of a1 and a2
    initial: float = 1.0  # initial variance P0 of x(k), x(k-1) and b1


@dataclass(frozen=True)
class Identification:
    """Identified coefficients and steady state of the platform, with the shape (windows,) each."""

    a1: Array
    a2: Array
    b1: Array  # in the unit of the signal
    gain: Array  # steady state in the unit of the signal, NaN if it does not exist
    variance: Array  # variance of `gain` by first-order error propagation

    def in_unit(self, scale: Array) -> Self:
        """Return the result for the signals multiplied by the factors `scale`, (windows,)."""
        return replace(
            self, b1=scale * self.b1, gain=scale * self.gain, variance=scale * scale * self.variance
        )


def identify(
    samples: Array,
    variance: Array,
    noise: Noise,
    *,
    inputs: Array | None = None,
    counts: NDArray[np.int64] | None = None,
    rise: Any = 1.0,
    start_from_samples: bool = False,
) -> Identification:
    r"""Identify the platform from its response to a load.

    The EKF uses the transition :math:`X' = f(X)` with the Jacobian

    .. math:: F = \begin{pmatrix} -a_1 & -a_2 & -x(k) & -x(k-1) & u \\ 1 & 0 & 0 & 0 & 0 \\
       0 & 0 & 1 & 0 & 0 \\ 0 & 0 & 0 & 1 & 0 \\ 0 & 0 & 0 & 0 & 1 \end{pmatrix}

    and the measurement matrix C = [1 0 0 0 0]. The filter is written in scalars, for the upper
    triangle of the symmetric covariance, because for 5 x 5 matrices the calls of a library take
    longer than the arithmetic.

    Parameters
    ----------
    samples : ndarray, (windows, n) float64
        Responses, normalised to a steady state of about 1 for u = 1. The initial state and its
        covariance have no unit, so otherwise the result would depend on the unit of the samples.
    variance : ndarray, (windows,) float64
        Variance in the squared unit of `samples`, by which R is scaled. R is at least 1e-14, so
        that the filter remains regular if a signal has no noise.
    noise : Noise
        Variances R, Q and P0.
    inputs : ndarray, (windows, k) float64, optional
        Inputs u of the steps that lead to the first k samples, with k at most n. Later inputs are
        1. By default, all inputs are 1.
    counts : ndarray, (windows,) int, optional
        Number of samples in each window. The other samples of a row are ignored. The default is n.
    rise : float or ndarray, (windows,)
        Factor by which R is multiplied while u is below 1.
    start_from_samples : bool
        If True, x(-1) and x(0) are the first two samples with P0 = R, and the filter begins with
        the third sample. Otherwise X0 is 0.

    Returns
    -------
    Identification
        Result of each window. It does not depend on the other windows, to the last bit.

    References
    ----------
    Long et al., A novel dynamic weighing method integrating improved stationary wavelet denoising
    and extended Kalman system identification, eq. 5-16, with the errata in docs/method.md.

    Examples
    --------
    >>> ringing = [1 + 0.9**k * np.cos(0.3 * k) for k in range(60)]
    >>> noise = Noise(measurement=1e-9, process=0.0, coefficients=1.0)
    >>> found = identify(np.array([ringing]), np.ones(1), noise, start_from_samples=True)
    >>> print(found.gain.round(4), found.a2.round(4))  # a2 is 0.9 squared
    [1.] [0.81]
    """
    windows, length = samples.shape
    lengths = [length] if counts is None else sorted(set(counts.tolist()))
    measurement = np.maximum(noise.measurement * variance, _LEAST_MEASUREMENT)[:, None]
    z, r_at_rest = _by_sample(samples), _by_sample(measurement)[0]
    u: Iterator[Any] = repeat(1.0)
    r: Iterator[Any] = repeat(r_at_rest)
    if inputs is not None:
        of_rise = np.asarray(rise).reshape(-1, 1) * measurement
        u = chain(_by_sample(inputs), u)
        r = chain(_by_sample(np.where(inputs < 1.0, of_rise, measurement)), r)
    x, x_before, p0, begin = 0.0, 0.0, noise.initial, 0
    if start_from_samples:
        x_before, x, p0, begin = z[0], z[1], r_at_rest, 2
        u, r = islice(u, begin, None), islice(r, begin, None)
    state: _State = (
        x, x_before, 0.0, 0.0, 0.0,
        p0, 0.0, 0.0, 0.0, 0.0,
        p0, 0.0, 0.0, 0.0,
        noise.coefficients, 0.0, 0.0,
        noise.coefficients, 0.0,
        noise.initial,
    )  # fmt: skip
    found = np.empty((5, windows))
    with np.errstate(all='ignore'):
        for end in lengths:
            state = _filter(state, z[begin:end], u, r, noise.process * r_at_rest)
            begin = end
            ended = slice(None) if len(lengths) == 1 else counts == end
            found[:, ended] = np.array(_identified(state)).reshape(5, -1)[:, ended]
    return Identification(*found)


_LEAST_MEASUREMENT = 1e-14


def _by_sample(values: Array) -> Any:
    """Return the transpose of `values`, (windows, n), or a list of n floats for one window.

    The arithmetic on floats gives the same results to the last bit as the arithmetic on arrays of
    one number, and is 20 times as fast.
    """
    return values[0].tolist() if len(values) == 1 else np.ascontiguousarray(values.T)


# The state is x(k), x(k-1), a1, a2, b1, and the upper triangle of the covariance.
_State = tuple[Any, ...]


def _filter(
    state: _State, samples: Iterable[Any], inputs: Iterable[Any], measurement: Iterable[Any], q: Any
) -> _State:
    """Return the filter state after all samples.

    The elements of the state are floats or arrays, (windows,). `inputs` and `measurement` contain u
    and R for each sample, and may be longer than `samples`. The variance `q` of x is the only
    element of Q that is not 0.
    """
    x, y, a1, a2, b = state[:5]
    p11, p12, p13, p14, p15, p22, p23, p24, p25, p33, p34, p35, p44, p45, p55 = state[5:]
    # Do not assign in place, because several names share an array.
    for z, u, r in zip(samples, inputs, measurement, strict=False):
        # Compute row 1 of F P, and the first element g0 of F P F' + Q. Row 2 of F P is row 1 of P.
        g1 = u * p15 - a1 * p11 - a2 * p12 - x * p13 - y * p14
        g2 = u * p25 - a1 * p12 - a2 * p22 - x * p23 - y * p24
        g3 = u * p35 - a1 * p13 - a2 * p23 - x * p33 - y * p34
        g4 = u * p45 - a1 * p14 - a2 * p24 - x * p34 - y * p44
        g5 = u * p55 - a1 * p15 - a2 * p25 - x * p35 - y * p45
        g0 = u * g5 - a1 * g1 - a2 * g2 - x * g3 - y * g4 + q
        x, y = u * b - a1 * x - a2 * y, x
        # Update the state to X + K (Z - C X) and the covariance to P - K C P. The gain is
        # K = P C' / (C P C' + R), where P C' is (g0, g1, g3, g4, g5).
        f = 1.0 / (g0 + r)
        e = f * (z - x)
        x = x + g0 * e
        y = y + g1 * e
        a1 = a1 + g3 * e
        a2 = a2 + g4 * e
        b = b + g5 * e
        k = f * g1
        p22 = p11 - k * g1
        p23 = p13 - k * g3
        p24 = p14 - k * g4
        p25 = p15 - k * g5
        k = f * g3
        p33 = p33 - k * g3
        p34 = p34 - k * g4
        p35 = p35 - k * g5
        k = f * g4
        p44 = p44 - k * g4
        p45 = p45 - k * g5
        p55 = p55 - f * g5 * g5
        h = r * f  # h is 1 minus the Kalman gain of x, computed without cancellation.
        p11, p12 = h * g0, h * g1
        p13, p14, p15 = h * g3, h * g4, h * g5
    return (
        x, y, a1, a2, b,
        p11, p12, p13, p14, p15, p22, p23, p24, p25, p33, p34, p35, p44, p45, p55,
    )  # fmt: skip


def _identified(state: _State) -> tuple[Any, ...]:
    _, _, a1, a2, b1, *_, p33, p34, p35, p44, p45, p55 = state
    total = np.add(1.0 + a1, a2)
    # The derivatives of the gain with respect to a1, a2 and b1 are (-gain, -gain, 1) / total.
    gain = b1 / total
    spread = gain * gain * (p33 + 2 * p34 + p44) - 2 * gain * (p35 + p45) + p55
    nothing = total / total - 1.0  # This is NaN if the total is 0 or not finite, otherwise 0.
    return a1, a2, b1, gain + nothing, spread / total / total + nothing


def platform_poles(a1: float, a2: float, sample_rate: float) -> tuple[float, float]:
    r"""Return the natural frequency in Hz and the damping ratio of an identified platform.

    Both results are NaN unless the poles are a stable complex pair
    :math:`e^{(-\xi \pm j \sqrt{1 - \xi^2}) \omega_n T}`, where T is the sampling interval. The
    coefficients are then :math:`a_1 = -2 e^{-\xi \omega_n T} \cos(\omega_n \sqrt{1 - \xi^2} T)` and
    :math:`a_2 = e^{-2 \xi \omega_n T}`.

    Examples
    --------
    >>> frequency, damping = platform_poles(-1.90997, 0.97059, 960.0)
    >>> print(f'{frequency:.1f} Hz, {damping:.3f}')
    38.0 Hz, 0.060
    """
    if not (0 < a2 < 1 and a1 * a1 < 4 * a2):
        return math.nan, math.nan
    decay = -0.5 * math.log(a2)
    angle = math.acos(-a1 / (2 * math.sqrt(a2)))
    modulus = math.hypot(decay, angle)
    return modulus * sample_rate / (2 * math.pi), decay / modulus


def is_stable(a1: Any, a2: Any) -> Any:
    """Return whether both poles of a platform are inside the unit circle.

    `a1` and `a2` are floats or arrays. The result is False where `a1` or `a2` is NaN.
    """
    return (abs(a2) < 1) & (abs(a1) < 1 + a2)
