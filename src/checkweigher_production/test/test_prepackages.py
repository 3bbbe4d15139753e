# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limits of Directive 76/211/EEC against numbers worked by hand."""

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_production.prepackages import judge_batch, tolerable_negative_error

EXACT = 1e-12  # relative


@pytest.mark.parametrize(
    ('nominal', 'error'),
    [
        (0.005, 0.5e-3),  # 9 %, rounded up to 0.1 g
        (0.008, 0.8e-3),
        (0.010, 0.9e-3),  # 9 % is a tenth of a gram already
        (0.050, 4.5e-3),
        (0.100, 4.5e-3),
        (0.125, 5.7e-3),  # 4.5 % of it are 5.625 g
        (0.150, 6.8e-3),
        (0.200, 9e-3),
        (0.300, 9e-3),
        (0.500, 15e-3),
        (1.0, 15e-3),
        (2.0, 30e-3),  # 1.5 %
        (10.0, 150e-3),
    ],
)
def test_tolerable_negative_errors_are_those_worked_by_hand(nominal, error):
    assert tolerable_negative_error(nominal) == pytest.approx(error, rel=EXACT)


@given(st.floats(0.005, 10), st.floats(0.005, 10))
def test_a_larger_prepackage_may_lack_more_but_a_smaller_share(one, other):
    small, large = sorted((one, other))
    errors = tolerable_negative_error(small), tolerable_negative_error(large)

    assert errors[0] <= errors[1] * (1 + 1e-6)
    # A percentage is rounded up by less than 0.1 g.
    assert (errors[1] - 1e-4) / large <= errors[0] / small * (1 + 1e-6)


@pytest.mark.parametrize('nominal', [0.0, 0.00499, 10.001, -0.1, math.nan])
def test_a_nominal_quantity_without_a_row_is_refused(nominal):
    with pytest.raises(ValueError, match=r'not in 0\.005\.\.10 kg'):
        tolerable_negative_error(nominal)


def test_a_batch_at_its_limits_passes():
    # 100 g: TU1 95.5 g, TU2 91 g. One of 40, that is 2.5 %, is below TU1, at TU2.
    batch = judge_batch([0.091] + [0.0955] * 2 + [0.101] * 37, 0.1)

    assert (batch.below_tu1, batch.below_tu2) == (1, 0)
    assert batch.share_below_tu1 == 0.025
    assert batch.mean == pytest.approx((91 + 191 + 37 * 101) / 40 * 1e-3, rel=EXACT)
    assert batch.passed


def test_each_requirement_fails_a_batch():
    batch = judge_batch([0.0909] + [0.101] * 9999, 0.1)

    assert batch.mean_passed
    assert batch.tu1_passed
    assert batch.below_tu2 == 1
    assert not batch.passed
    batch = judge_batch([0.0954] + [0.101] * 38, 0.1)

    assert (batch.below_tu1, batch.tu1_passed, batch.tu2_passed) == (1, False, True)
    assert not batch.passed
    assert judge_batch([0.0999] * 10, 0.1).mean_passed is False
    # 0.1 has no exact binary form: the sum of three is not 0.3.
    assert judge_batch([0.1] * 3, 0.1).passed


@pytest.mark.parametrize('masses', [[], [0.1, math.nan]])
def test_a_batch_that_cannot_be_judged_is_refused(masses):
    with pytest.raises(ValueError, match=r'batch of no|not finite'):
        judge_batch(masses, 0.1)
