r"""Identification of the weighing platform by an extended Kalman filter (EKF).

The platform with a load on it obeys :math:`x(k) = -a_1 x(k-1) - a_2 x(k-2) + b_1 u(k-1)`, so
that the load is its steady state :math:`b_1 / (1 + a_1 + a_2)`. The filter estimates signal and
coefficients together, state :math:`X = [x(k), x(k-1), a_1, a_2, b_1]`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
import math


@dataclass(frozen=True, slots=True)
class Noise:
    """Variances that the filter works with; the signal is normalised to about 1.

    Attributes
    ----------
    process : float
        Of x per step, Q[0, 0]; the coefficients are constant.
    measurement : float
        Of a sample, R.
    initial : float
        Of each state at the start, P0 = initial * I.
    """

    process: float
    measurement: float
    initial: float = 1.0


@dataclass(frozen=True, slots=True)
class Identification:
    """Coefficients after the last sample and what follows from them.

    Attributes
    ----------
    a1, a2, b1 : float
        Of the difference equation.
    gain : float
        Steady state b1 / (1 + a1 + a2).
    variance : float
        Of `gain`, from the covariance of the coefficients to first order.
    """

    a1: float
    a2: float
    b1: float
    gain: float
    variance: float


def identify(samples: Iterable[float], noise: Noise) -> Identification:
    r"""Identify the platform from its response to a constant load.

    Predict and update are the EKF with transition :math:`X' = f(X)` and its Jacobian

    .. math:: F = \begin{pmatrix} -a_1 & -a_2 & -x(k) & -x(k-1) & u \\ 1 & 0 & 0 & 0 & 0 \\
       0 & 0 & 1 & 0 & 0 \\ 0 & 0 & 0 & 1 & 0 \\ 0 & 0 & 0 & 0 & 1 \end{pmatrix}

    and C = [1 0 0 0 0], written out in scalars for the upper triangle of the symmetric covariance:
    a matrix library spends more on calls of 5 x 5 than on arithmetic.

    Parameters
    ----------
    samples : iterable of float
        Response to u = 1, normalised so that the steady state is about 1: start and covariance
        have no unit, so without that the result would depend on the unit of the samples.
    noise : Noise
        Variances.

    Returns
    -------
    Identification
        NaN where the filter has diverged or 1 + a1 + a2 is 0.

    References
    ----------
    Long et al., A novel dynamic weighing method integrating improved stationary wavelet denoising
    and extended Kalman system identification, eq. 5-16, with the errata in docs/method.md.
    """
    q, r = noise.process, noise.measurement
    x = y = a1 = a2 = b = 0.0
    p11 = p22 = p33 = p44 = p55 = noise.initial
    p12 = p13 = p14 = p15 = p23 = p24 = p25 = p34 = p35 = p45 = 0.0
    for z in samples:
        # Row 1 of F P, then F P F' + Q.
        g1 = -a1 * p11 - a2 * p12 - x * p13 - y * p14 + p15
        g2 = -a1 * p12 - a2 * p22 - x * p23 - y * p24 + p25
        g3 = -a1 * p13 - a2 * p23 - x * p33 - y * p34 + p35
        g4 = -a1 * p14 - a2 * p24 - x * p34 - y * p44 + p45
        g5 = -a1 * p15 - a2 * p25 - x * p35 - y * p45 + p55
        p22, p23, p24, p25 = p11, p13, p14, p15
        p11 = -a1 * g1 - a2 * g2 - x * g3 - y * g4 + g5 + q
        p12, p13, p14, p15 = g1, g3, g4, g5
        x, y = -a1 * x - a2 * y + b, x
        # Gain K = P C' / (C P C' + R), X + K (Z - C X), P - K C P.
        s = p11 + r
        k1, k2, k3, k4, k5 = p11 / s, p12 / s, p13 / s, p14 / s, p15 / s
        e = z - x
        x += k1 * e
        y += k2 * e
        a1 += k3 * e
        a2 += k4 * e
        b += k5 * e
        p22 -= k2 * p12
        p23 -= k2 * p13
        p24 -= k2 * p14
        p25 -= k2 * p15
        p33 -= k3 * p13
        p34 -= k3 * p14
        p35 -= k3 * p15
        p44 -= k4 * p14
        p45 -= k4 * p15
        p55 -= k5 * p15
        h = r / s  # 1 - k1, without the cancellation
        p11, p12, p13, p14, p15 = h * p11, h * p12, h * p13, h * p14, h * p15
    total = 1.0 + a1 + a2
    if total == 0 or not math.isfinite(total):
        return Identification(a1, a2, b, math.nan, math.nan)
    gain = b / total
    # d gain / d (a1, a2, b) = (-gain, -gain, 1) / total
    spread = gain * gain * (p33 + 2 * p34 + p44) - 2 * gain * (p35 + p45) + p55
    return Identification(a1, a2, b, gain, spread / total / total)


def platform_poles(a1: float, a2: float, sample_rate: float) -> tuple[float, float]:
    r"""Return natural frequency and damping ratio of the identified platform.

    From the poles :math:`e^{(-\xi \pm j \sqrt{1 - \xi^2}) \omega_n T}` of
    :math:`a_1 = -2 e^{-\xi \omega_n T} \cos(\omega_n \sqrt{1 - \xi^2} T)`,
    :math:`a_2 = e^{-2 \xi \omega_n T}`.

    Parameters
    ----------
    a1, a2 : float
        Coefficients.
    sample_rate : float
        Hz.

    Returns
    -------
    natural_frequency : float
        Hz, NaN unless the poles are a stable complex pair.
    damping_ratio : float
        1, NaN likewise.
    """
    if not (0 < a2 < 1 and a1 * a1 < 4 * a2):
        return math.nan, math.nan
    decay = -0.5 * math.log(a2)
    angle = math.acos(-a1 / (2 * math.sqrt(a2)))
    modulus = math.hypot(decay, angle)
    return modulus * sample_rate / (2 * math.pi), decay / modulus


def is_stable(a1: float, a2: float) -> bool:
    """Tell whether both poles lie inside the unit circle (the stability triangle)."""
    return abs(a2) < 1 and abs(a1) < 1 + a2
