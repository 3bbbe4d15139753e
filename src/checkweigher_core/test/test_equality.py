# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the equality of records that contain NaN, on each version of Python."""

from dataclasses import replace

import numpy as np

from checkweigher_core.records import MassEstimate, PerformanceState, PerformanceTest, WeighWindow

BLANK = MassEstimate(1, None, None, None)


def test_records_with_nan_are_equal_and_other_values_differ():
    # Each call of float() creates a new NaN object, as reading a message or a file does.
    one, other = (replace(BLANK, mass=0.1, zero=float('nan')) for _ in range(2))
    assert one == other
    assert hash(one) == hash(other)
    assert one != replace(other, mass=0.2)
    assert one != replace(other, mass=float('nan'))
    assert one != 'a record'


def test_nan_within_a_field_of_several_values_equals_nan():
    due = PerformanceTest(1, PerformanceState.OVERDUE)
    one, other = (replace(due, errors=(0.1, float('nan'))) for _ in range(2))
    assert one == other
    assert one != replace(other, errors=(0.2, float('nan')))
    one, other = (WeighWindow(1, None, None, None, denoised=np.full(2, np.nan)) for _ in range(2))
    assert one == other
