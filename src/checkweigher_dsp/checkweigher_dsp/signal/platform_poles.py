"""What the identified coefficients of the platform say of it."""

import math


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
