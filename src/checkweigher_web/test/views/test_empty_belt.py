# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Spectrum of the empty belt, compared with sines of known frequency and amplitude."""

import numpy as np
import pytest

from checkweigher_web.views.empty_belt import spectrum

RATE = 960.0  # Hz
TIME = np.arange(4 * 960) / RATE


def test_lines_have_the_frequency_and_amplitude_of_their_sines():
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(TIME))
    sines = {13: 2e-3, 38: 1e-3, 50: 1e-3}  # amplitudes in kg by frequencies in Hz
    parts = [mass * np.sin(2 * np.pi * frequency * TIME) for frequency, mass in sines.items()]
    found = spectrum(sum(parts) + noise, RATE, belt_speed=1.0, platform=36.0)
    lines = [line for line in found.lines if line.amplitude > 1e-4]
    assert [line.frequency for line in lines] == pytest.approx([*sines], abs=0.25)
    assert [line.amplitude for line in lines] == pytest.approx([*sines.values()], rel=0.02)
    # 1 m/s / (pi 13 Hz) = 24.5 mm
    assert 'roller of 24 mm' in lines[0].guess
    assert 'platform' in lines[1].guess
    assert lines[2].guess.startswith('mains')


def test_noise_has_no_strong_line():
    found = spectrum(1e-3 * np.random.default_rng(2).standard_normal(len(TIME)), RATE)
    assert all(line.amplitude < 2e-4 for line in found.lines)


def test_a_short_stretch_has_no_spectrum():
    assert spectrum(np.zeros(100), RATE) is None
