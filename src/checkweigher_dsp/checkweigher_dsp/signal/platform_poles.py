# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Natural frequency, damping ratio and stability of a platform from its identified coefficients."""

import math
from typing import Any


def platform_poles(a1: float, a2: float, sample_rate: float) -> tuple[float, float]:
    r"""Return the natural frequency in Hz and the damping ratio of an identified platform.

    Both are NaN unless the poles are a stable complex pair :math:`e^{(-\xi \pm j \sqrt{1 - \xi^2})
    \omega_n T}`. The coefficients are then :math:`a_1 = -2 e^{-\xi \omega_n T} \cos(\omega_n
    \sqrt{1 - \xi^2} T)` and :math:`a_2 = e^{-2 \xi \omega_n T}`.

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
    """Return whether both poles lie inside the unit circle. The result is False for NaN."""
    return (abs(a2) < 1) & (abs(a1) < 1 + a2)
