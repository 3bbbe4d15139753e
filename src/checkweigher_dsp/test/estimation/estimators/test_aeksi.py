# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The EKF behind the adaptive prefilter, alone and in batches."""

import math

import numpy as np
import pytest

from checkweigher_dsp.estimation.estimators.aeksi import identify_adaptive_by_ekf
from checkweigher_dsp.estimation.estimators.aid import AdaptiveSettings
from checkweigher_dsp.signal.extended_kalman import Noise

RATE = 960.0
SETTINGS = AdaptiveSettings(3, 2, 300.0)
NOISE = Noise(1.0, 0.1, 1.0)


def test_a_window_has_the_same_bits_in_any_batch():
    random, k = np.random.default_rng(1), np.arange(96)
    ringing = 0.2 + 0.01 * 0.97**k * np.cos(0.25 * k)
    windows = ringing + 1e-4 * random.standard_normal((5, 96))
    windows[3] = math.nan

    together = identify_adaptive_by_ekf(windows, SETTINGS, NOISE, RATE)

    for number in range(5):
        alone = identify_adaptive_by_ekf(windows[[number]], SETTINGS, NOISE, RATE)
        for name in ('a1', 'a2', 'b1', 'gain', 'variance', 'stable'):
            assert repr(getattr(together, name)[number]) == repr(getattr(alone, name)[0])
    assert together.stable.tolist() == [True, True, True, False, True]
    assert math.isnan(together.gain[3])


def test_poles_outside_the_circle_fall_back_to_the_mean_of_the_window():
    growing = 0.2 + 1e-3 * 1.05 ** np.arange(96)
    found = identify_adaptive_by_ekf(growing[np.newaxis], AdaptiveSettings(1), NOISE, RATE)
    assert not found.stable[0]
    assert found.gain == pytest.approx([growing.mean()], rel=1e-9)
    assert (found.a1[0], found.a2[0]) == (0, 0)
