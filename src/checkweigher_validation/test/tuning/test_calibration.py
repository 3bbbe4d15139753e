# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gain, offset, A and uncertainty, compared with numbers worked by hand and random errors."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_validation.tuning.calibration import (
    Calibration,
    Uncertainty,
    calibrate,
    calibrated_index,
    folds,
    held_out_errors,
    index,
    uncertainty,
)

EXACT = 1e-9  # relative
DRAWN = 0.05  # relative, for standard deviations from some thousand draws
MASSES = np.array((0.0745, 0.1345, 0.1645, 0.1945, 0.2545))


class TestCalibrate:
    def test_gain_and_offset_of_a_straight_line_are_found(self):
        masses = np.repeat((0.1, 0.2, 0.4), 2)
        found = calibrate((masses - 0.002) / 1.25, masses)
        assert (found.gain, found.offset) == pytest.approx((1.25, 0.002), rel=EXACT)
        assert found.apply(np.array((0.08,))) == pytest.approx([0.102], rel=EXACT)

    def test_worked_by_hand_with_errors(self):
        # Estimates 1, 1, 1, 3, 3, 3 of masses 0.9, 1, 1.1, 2.8, 3, 3.2: line through the means
        # (1, 1) and (3, 3).
        found = calibrate(
            np.array((1.0, 1.0, 1.0, 3.0, 3.0, 3.0)), np.array((0.9, 1.0, 1.1, 2.8, 3.0, 3.2))
        )
        assert (found.gain, found.offset) == pytest.approx((1.0, 0.0), abs=1e-12)

    @pytest.mark.parametrize(
        'masses',
        [
            (2.0,) * 8,  # one mass
            (2.0, 3.0, 2.0, 3.0, 2.0),  # few passes
            (1.0, 1.19, 1.0, 1.19, 1.0, 1.19),  # masses that hardly differ
        ],
    )
    def test_then_there_is_no_offset(self, masses):
        masses = np.array(masses)
        found = calibrate(masses / 1.5 + 0.1, masses)
        assert found.offset == 0.0

    def test_a_gain_alone_worked_by_hand(self):
        # (1 * 2 + 3 * 2) / (1 * 1 + 3 * 3)
        found = calibrate(np.array((1.0, 3.0)), np.array((2.0, 2.0)))
        assert found == Calibration(pytest.approx(0.8, rel=EXACT), 0.0)


class TestIndex:
    def test_two_masses_worked_by_hand(self):
        # Mean 0 and sigma 1; mean -2 and sigma 0: (3 + 2) / 2.
        errors = np.array((1.0, -1.0, 1.0, -1.0, 0.0, -2.0, -2.0, -2.0, -2.0, -2.0))
        masses = np.array((0.1,) * 5 + (0.2,) * 5)
        assert index(errors, masses) == pytest.approx(2.5, rel=EXACT)

    def test_masses_with_fewer_than_five_passes_count_together(self):
        # Five of 0.1 kg with mean 1 and sigma 0; of the others 1, -1, 1, -1, 0 together.
        errors = np.array((1.0, 1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 0.0))
        masses = np.array((0.1, 0.2, 0.2, 0.1, 0.2, 0.1, 0.3, 0.1, 0.1, 0.4))
        assert index(errors, masses) == pytest.approx((1 + 3) / 2, rel=EXACT)

    def test_after_calibration_a_line_has_none(self):
        masses = np.tile(MASSES, 3)
        assert calibrated_index(0.9 * masses + 0.01, masses) == pytest.approx(0.0, abs=1e-12)

    @pytest.mark.parametrize('bad', [math.nan, math.inf, 0.0, -0.1])
    def test_with_a_pass_that_has_no_mass_it_is_infinite(self, bad):
        masses = np.tile(MASSES, 3)
        estimates = masses.copy()
        estimates[7] = bad
        assert calibrated_index(estimates, masses) == math.inf


@given(st.lists(st.sampled_from((0.1, 0.2, 0.3, 0.5)), min_size=1, max_size=60), st.integers(2, 6))
def test_folds_are_of_a_size_and_so_is_the_share_of_each_mass_in_them(masses, count):
    masses = np.array(masses)
    fold = folds(masses, count)
    used = min(count, len(masses))
    assert np.ptp(np.bincount(fold, minlength=used)) <= 1
    assert set(fold) == set(range(used))
    for mass in set(masses):
        own = fold[masses == mass]
        assert np.ptp(np.bincount(own, minlength=used)) <= 1
        assert np.all(np.diff(own) != 0)


class TestHeldOut:
    def test_errors_are_those_of_a_line_through_the_other_folds(self):
        draw = np.random.default_rng(2)
        masses = np.tile(MASSES, 5)
        estimates = masses + 1e-3 * draw.standard_normal(25)
        fold = folds(masses, 5)
        errors = held_out_errors(estimates, masses)
        for number in range(25):
            others = fold != fold[number]
            design = np.stack((estimates[others], np.ones(20)), axis=1)
            gain, offset = np.linalg.lstsq(design, masses[others], rcond=None)[0]
            expected = gain * estimates[number] + offset - masses[number]
            assert errors[number] == pytest.approx(expected, rel=1e-6, abs=1e-12)

    def test_masses_that_come_in_turn_are_not_extrapolated(self):
        # Five masses in turn and a bent characteristic: within the range of the masses a line
        # misses it by little, beyond it by more.
        masses = np.tile(MASSES, 6)
        estimates = masses + 0.1 * (masses - masses.mean()) ** 2
        fitted = calibrate(estimates, masses).apply(estimates) - masses
        assert np.max(abs(held_out_errors(estimates, masses))) < 1.3 * np.max(abs(fitted))


class TestUncertainty:
    @pytest.mark.parametrize(('std_dev', 'relative'), [(1e-4, 0.0), (0.0, 1e-3), (1e-4, 8e-4)])
    def test_both_parts_are_found_in_drawn_errors(self, std_dev, relative):
        masses = np.tile(MASSES, 1500)
        draw = np.random.default_rng(3)
        sigma = np.hypot(std_dev, relative * masses)
        found = uncertainty(sigma * draw.standard_normal(len(masses)), masses)
        stated = np.hypot(found.std_dev, found.relative * MASSES)
        assert stated == pytest.approx(np.hypot(std_dev, relative * MASSES), rel=DRAWN)

    def test_worked_by_hand_for_one_mass(self):
        # The two-sided 95 % point of Student's distribution with 1 degree of freedom is 12.7062,
        # that of the normal one 1.95996.
        found = uncertainty(np.array((3.0, -4.0)), np.array((2.0, 2.0)))
        std_dev = math.hypot(found.std_dev, 2 * found.relative)
        expected = math.sqrt((9 + 16) / 2) * 12.7062 / 1.95996
        assert std_dev == pytest.approx(expected, rel=1e-5)

    def test_one_mass_leaves_the_growth_to_the_prior_and_many_passes_do_not(self):
        draw = np.random.default_rng(4).standard_normal(1000)
        one = uncertainty(1e-4 * draw[:20], np.full(20, 0.2))
        assert (one.relative * 0.2 / one.std_dev) ** 2 == pytest.approx(0.4 / 0.6, rel=0.03)
        masses = np.tile(MASSES, 200)
        flat, steep = uncertainty(1e-4 * draw, masses), uncertainty(1e-3 * masses * draw, masses)
        ratios = [
            math.hypot(each.std_dev, 0.25 * each.relative)
            / math.hypot(each.std_dev, 0.1 * each.relative)
            for each in (flat, one, steep)
        ]
        assert 1.0 < ratios[0] < 1.1 < ratios[1] < 1.4 < 2.0 < ratios[2] < 2.5

    def test_after_five_passes_its_95_percent_interval_covers_another_one(self):
        draw = np.random.default_rng(5)
        covered = []
        for _ in range(1000):
            *errors, other = draw.standard_normal(6)
            found = uncertainty(np.array(errors), np.ones(5))
            covered.append(abs(other) <= 1.96 * math.hypot(found.std_dev, found.relative))
        assert 0.93 <= np.mean(covered) <= 0.98

    def test_without_errors_there_is_none(self):
        assert uncertainty(np.zeros(10), np.tile(MASSES, 2)) == Uncertainty(0.0, 0.0)
