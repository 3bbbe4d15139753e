# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Platforms and noises whose theory is known."""

import math

import numpy as np
from scipy.linalg import toeplitz
from scipy.signal import lfilter

RATE = 960.0  # Hz


def coefficients(frequency: float, damping: float) -> tuple[float, float]:
    """Return a1 and a2 of a platform at `RATE` by the closed forms of the method."""
    step = 2 * math.pi * frequency / RATE
    damped = step * math.sqrt(1 - damping**2)
    return -2 * math.exp(-damping * step) * math.cos(damped), math.exp(-2 * damping * step)


def covariance(model: np.ndarray, std_dev: float, count: int) -> np.ndarray:
    """Return the covariance of a stationary autoregression, from its impulse response."""
    impulse = np.zeros(20_000)
    impulse[0] = std_dev
    response = lfilter([1.0], model, impulse)
    return toeplitz([response[: len(response) - k] @ response[k:] for k in range(count)])
