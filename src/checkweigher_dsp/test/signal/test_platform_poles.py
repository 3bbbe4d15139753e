# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Poles and stability of the platform against its closed forms and numpy's roots."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from known_models import RATE, coefficients
import numpy as np
import pytest

from checkweigher_dsp.signal.extended_kalman import is_stable, platform_poles


@given(st.floats(1.0, 400.0), st.floats(0.01, 0.9))
def test_poles_are_those_of_the_closed_forms(frequency, damping):
    a1, a2 = coefficients(frequency, damping)
    found = platform_poles(a1, a2, RATE)
    # The arc cosine loses half the digits where the angle is small.
    assert found == pytest.approx((frequency, damping), rel=1e-6)


@pytest.mark.parametrize(
    ('a1', 'a2'),
    [
        (-1.5, 0.5),  # poles 1 and 0.5
        (-1.0, 0.24),  # 0.6 and 0.4: real, no oscillation
        (-1.0, 1.0),  # on the unit circle
        (-1.0, 1.2),  # outside
        (0.0, -0.5),  # real, of opposite sign
        (math.nan, math.nan),
    ],
)
def test_what_does_not_oscillate_or_dies_not_out_has_no_frequency(a1, a2):
    assert all(math.isnan(value) for value in platform_poles(a1, a2, RATE))


@settings(max_examples=300)
@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_stability_agrees_with_the_roots(a1, a2):
    radius = np.abs(np.roots([1.0, a1, a2])).max(initial=0.0)
    # A root on the circle is found with the square root of the rounding.
    if abs(radius - 1) > 1e-6:
        assert is_stable(a1, a2) == (radius < 1)


def test_nan_is_not_stable():
    assert not is_stable(math.nan, 0.5)
    assert not is_stable(0.5, math.nan)
