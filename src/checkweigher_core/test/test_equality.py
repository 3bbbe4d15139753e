# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the equality of records that contain NaN, on each version of Python."""

from dataclasses import replace

from checkweigher_core.records import MassEstimate

BLANK = MassEstimate(1, None, None, None)


def test_records_with_nan_are_equal_and_other_values_differ():
    # Each call of float() creates a new NaN object, as reading a message or a file does.
    one, other = (replace(BLANK, mass=0.1, zero=float('nan')) for _ in range(2))
    assert one == other
    assert hash(one) == hash(other)
    assert one != replace(other, mass=0.2)
    assert one != replace(other, mass=float('nan'))
    assert one != 'a record'
