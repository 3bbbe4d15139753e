# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The notch filter against its transfer function, and the trimmed mean against numbers by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from synthetic_line import make_pass

from checkweigher_dsp.estimation.estimators.base import raw_samples
from checkweigher_dsp.estimation.estimators.lms_notch import LmsNotch, LmsNotchParameters, notch


@pytest.mark.parametrize('angle', [0.03, 0.25, 1.5])
@pytest.mark.parametrize('step', [0.005, 0.05, 0.4])
def test_with_a_constant_step_it_is_the_linear_notch_of_glover(angle, step):
    # J. R. Glover, Adaptive noise canceling applied to sinusoidal interferences, 1977.
    signal = np.random.default_rng(1).standard_normal(200)
    zeros = [1.0, -2 * np.cos(angle), 1.0]
    poles = [1.0, -2 * (1 - step) * np.cos(angle), 1 - 2 * step]
    found = notch(signal, angle, step, sharpness=1e300)
    assert found == pytest.approx(lfilter(zeros, poles, signal), abs=1e-12)


def test_the_step_follows_the_versiera():
    # First error 1, so that mu = 0.2 (1 - 1 / (1 + 3)) = 0.15 and w = (0.3, 0).
    assert notch(np.array([1.0, 0.5]), np.pi / 3, 0.2, 3.0).tolist() == pytest.approx([1.0, 0.35])


def test_means_are_trimmed_on_each_side():
    window = make_pass(0.2)
    samples = np.arange(raw_samples(window).size) % 10 / 10 + 0.1  # kg
    counts = window.counts.copy()
    counts[window.window_begin : window.window_end] = samples * window.counts_per_kg + window.zero
    known = LmsNotchParameters(step=(0.0,), smoothing=(0.0,), cut_low=(0.4,), cut_high=(0.2,))
    found = LmsNotch(known).estimate(replace(window, counts=counts)).mass
    ordered = np.sort(samples)
    kept = ordered[int(0.4 * len(ordered)) : len(ordered) - int(0.2 * len(ordered))]
    assert found == pytest.approx(np.mean(kept), rel=1e-6)
