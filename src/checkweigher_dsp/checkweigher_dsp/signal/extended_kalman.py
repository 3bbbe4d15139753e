r"""Identification of the weighing platform by an extended Kalman filter (EKF).

The platform with a load on it obeys :math:`x(k) = -a_1 x(k-1) - a_2 x(k-2) + b_1 u(k-1)`, so
that the load is its steady state :math:`b_1 / (1 + a_1 + a_2)`. The filter estimates signal and
coefficients together, state :math:`X = [x(k), x(k-1), a_1, a_2, b_1]`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import repeat
import math
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Noise:
    """Variances that the filter works with; the signal is normalised to about 1.

    Each is a float or, where many signals are identified at once, an array (passes,).

    Attributes
    ----------
    process : float
        Of x per step, Q[0, 0]; the coefficients are constant.
    measurement : float
        Of a sample, R.
    initial : float
        Of x(k), x(k-1) and b1 at the start, their entries of the diagonal P0.
    coefficients : float, optional
        Of a1 and a2 at the start; by default as the others, P0 = initial * I.
    states : float, optional
        Of x(k) and x(k-1) at the start, if not `initial`.
    """

    process: Any
    measurement: Any
    initial: Any = 1.0
    coefficients: Any = None
    states: Any = None


@dataclass(frozen=True, slots=True)
class Start:
    """The state before the first sample, X0: floats or arrays (passes,)."""

    x: Any = 0.0
    x_before: Any = 0.0
    a1: Any = 0.0
    a2: Any = 0.0
    b1: Any = 0.0


@dataclass(frozen=True, slots=True)
class Identification:
    """Coefficients after the last sample and what follows from them; floats or arrays (passes,).

    Attributes
    ----------
    a1, a2, b1 : float
        Of the difference equation.
    gain : float
        Steady state b1 / (1 + a1 + a2).
    variance : float
        Of `gain`, from the covariance of the coefficients to first order.
    """

    a1: Any
    a2: Any
    b1: Any
    gain: Any
    variance: Any


_AT_REST = Start()


def identify(
    samples: Iterable[Any],
    noise: Noise,
    inputs: Iterable[Any] | None = None,
    *,
    start: Start = _AT_REST,
    measurement: Iterable[Any] | None = None,
) -> Identification:
    r"""Identify the platform from its response to a load.

    Predict and update are the EKF with transition :math:`X' = f(X)` and its Jacobian

    .. math:: F = \begin{pmatrix} -a_1 & -a_2 & -x(k) & -x(k-1) & u \\ 1 & 0 & 0 & 0 & 0 \\
       0 & 0 & 1 & 0 & 0 \\ 0 & 0 & 0 & 1 & 0 \\ 0 & 0 & 0 & 0 & 1 \end{pmatrix}

    and C = [1 0 0 0 0], written out in scalars for the upper triangle of the symmetric covariance:
    a matrix library spends more on calls of 5 x 5 than on arithmetic. The same lines identify many
    signals at once if each sample is an array.

    Parameters
    ----------
    samples : iterable of float or of ndarray, (passes,)
        Response, normalised so that the steady state for u = 1 is about 1: start and covariance
        have no unit, so without that the result would depend on the unit of the samples.
    noise : Noise
        Variances.
    inputs : iterable of float or of ndarray, optional
        u of the step that leads to each sample; by default 1.
    start : Start
        X0; by default 0.
    measurement : iterable of float or of ndarray, optional
        R of each sample; by default that of `noise`.

    Returns
    -------
    Identification
        NaN where the filter has diverged or 1 + a1 + a2 is 0.

    References
    ----------
    Long et al., A novel dynamic weighing method integrating improved stationary wavelet denoising
    and extended Kalman system identification, eq. 5-16, with the errata in docs/method.md.
    """
    inputs = repeat(1.0) if inputs is None else inputs
    measurement = repeat(noise.measurement) if measurement is None else measurement
    state = state_before(noise, start)
    return identified_by(state_after(state, samples, inputs, measurement, noise.process))


# x(k), x(k-1), a1, a2, b1, and the upper triangle of the covariance.
State = tuple[Any, ...]


def state_before(noise: Noise, start: Start) -> State:
    """Return the state before the first sample."""
    states = noise.initial if noise.states is None else noise.states
    coefficients = noise.initial if noise.coefficients is None else noise.coefficients
    return (
        start.x, start.x_before, start.a1, start.a2, start.b1,
        states, 0.0, 0.0, 0.0, 0.0,
        states, 0.0, 0.0, 0.0,
        coefficients, 0.0, 0.0,
        coefficients, 0.0,
        noise.initial,
    )  # fmt: skip


def state_after(
    state: State, samples: Iterable[Any], inputs: Iterable[Any], measurement: Iterable[Any], q: Any
) -> State:
    """Return the state after some samples."""
    x, y, a1, a2, b = state[:5]
    p11, p12, p13, p14, p15, p22, p23, p24, p25, p33, p34, p35, p44, p45, p55 = state[5:]
    # No assignment is in place: arrays would change under their other names.
    for z, u, r in zip(samples, inputs, measurement, strict=False):
        # Row 1 of F P, then with it the first element of F P F' + Q; row 2 of that is row 1 of P.
        g1 = u * p15 - a1 * p11 - a2 * p12 - x * p13 - y * p14
        g2 = u * p25 - a1 * p12 - a2 * p22 - x * p23 - y * p24
        g3 = u * p35 - a1 * p13 - a2 * p23 - x * p33 - y * p34
        g4 = u * p45 - a1 * p14 - a2 * p24 - x * p34 - y * p44
        g5 = u * p55 - a1 * p15 - a2 * p25 - x * p35 - y * p45
        g0 = u * g5 - a1 * g1 - a2 * g2 - x * g3 - y * g4 + q
        x, y = u * b - a1 * x - a2 * y, x
        # Gain K = P C' / (C P C' + R), X + K (Z - C X), P - K C P; P C' is (g0, g1, g3, g4, g5).
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
        h = r * f  # 1 less the gain of x, without the cancellation
        p11, p12 = h * g0, h * g1
        p13, p14, p15 = h * g3, h * g4, h * g5
    return (
        x, y, a1, a2, b,
        p11, p12, p13, p14, p15, p22, p23, p24, p25, p33, p34, p35, p44, p45, p55,
    )  # fmt: skip


def identified_by(state: State) -> Identification:
    """Return what a state says of the platform."""
    _, _, a1, a2, b, *_, p33, p34, p35, p44, p45, p55 = state
    # d gain / d (a1, a2, b) = (-gain, -gain, 1) / total, once divided by total
    total = _usable(1.0 + a1 + a2)
    gain = b / total
    spread = gain * gain * (p33 + 2 * p34 + p44) - 2 * gain * (p35 + p45) + p55
    return Identification(a1, a2, b, gain, spread / total / total)


def _usable(total: Any) -> Any:
    """Return 1 + a1 + a2, NaN where nothing can be divided by it."""
    if isinstance(total, float):
        return total if total != 0 and math.isfinite(total) else math.nan
    return np.where((total != 0) & np.isfinite(total), total, np.nan)
