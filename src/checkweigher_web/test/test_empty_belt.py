# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The spectrum of the empty belt against sines of known frequency and amplitude."""

import numpy as np
import pytest

from checkweigher_web.empty_belt import spectrum

RATE = 960.0  # Hz
TIME = np.arange(4 * 960) / RATE


def test_lines_have_the_frequency_and_amplitude_of_their_sines():
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(TIME))
    force = 2e-3 * np.sin(2 * np.pi * 13 * TIME) + 1e-3 * np.sin(2 * np.pi * 50 * TIME) + noise
    found = spectrum(force, RATE, belt_speed=1.0)
    assert found is not None
    lines = [line for line in found.lines if line.amplitude > 1e-4]
    assert [line.frequency for line in lines] == pytest.approx([13, 50], abs=0.25)
    assert [line.amplitude for line in lines] == pytest.approx([2e-3, 1e-3], rel=0.02)
    # 1 m/s / (pi 13 Hz) = 24.5 mm
    assert 'roller of 24 mm' in lines[0].guess
    assert lines[1].guess.startswith('mains')


def test_the_platform_is_named_by_its_natural_frequency():
    found = spectrum(1e-3 * np.sin(2 * np.pi * 38 * TIME), RATE, 1.0, platform=36.0)
    assert found is not None
    (line,) = (each for each in found.lines if each.amplitude > 1e-4)
    assert 'platform' in line.guess


def test_noise_has_no_strong_line():
    found = spectrum(1e-3 * np.random.default_rng(2).standard_normal(len(TIME)), RATE)
    assert found is not None
    assert all(line.amplitude < 2e-4 for line in found.lines)


def test_a_short_stretch_has_no_spectrum():
    assert spectrum(np.zeros(100), RATE) is None
