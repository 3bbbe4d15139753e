# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Static calibration against numbers worked by hand, scipy and repeated simulation."""

import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from checkweigher_driver.calibration.static_calibration import (
    CalibrationError,
    CalibrationPoint,
    calibrate,
    read_static,
    zero_only,
)

LIMITS = -(2**23), 2**23 - 1


def test_two_points_give_the_line_through_them():
    found = calibrate([CalibrationPoint(0.0, 1000.0, 3.0), CalibrationPoint(2.0, 5000.0, 4.0)])
    assert found.zero_counts == pytest.approx(1000.0, abs=1e-9)
    assert found.counts_per_kg == pytest.approx(2000.0, rel=1e-12)
    assert found.zero_uncertainty == pytest.approx(3.0, rel=1e-9)
    assert found.counts_per_kg_uncertainty == pytest.approx(math.hypot(3.0, 4.0) / 2, rel=1e-9)
    assert found.largest_residual == pytest.approx(0.0, abs=1e-12)


def test_uncertain_masses_make_the_sensitivity_uncertain():
    found = calibrate(
        [CalibrationPoint(0.0, 0.0, 1.0), CalibrationPoint(1.0, 1e6, 1.0, mass_uncertainty=1e-4)]
    )
    assert found.counts_per_kg_uncertainty == pytest.approx(100.01, rel=1e-4)
    assert found.zero_uncertainty == pytest.approx(1.0, rel=1e-6)


def test_several_points_agree_with_scipy():
    random = np.random.default_rng(3)
    masses = np.array([0.0, 0.1, 0.2, 0.5, 1.0, 0.0])
    sigma = np.array([2.0, 3.0, 2.0, 5.0, 4.0, 2.0])
    readings = 1234.5 - 5e5 * masses + 3 * sigma * random.normal(size=6)
    found = calibrate(
        [CalibrationPoint(*point) for point in zip(masses, readings, sigma, strict=True)]
    )
    values, covariance = curve_fit(
        lambda x, zero, slope: zero + slope * x, masses, readings, p0=(1e3, -4e5), sigma=sigma
    )  # scaled by chi-squared, as ours is where it is above 1
    assert [found.zero_counts, found.counts_per_kg] == pytest.approx(values, rel=1e-7)
    spread = np.sqrt(np.diag(covariance))
    assert [found.zero_uncertainty, found.counts_per_kg_uncertainty] == pytest.approx(
        spread, rel=1e-5
    )


def test_a_cell_that_is_not_straight_shows_in_its_residuals():
    # 1 % of 0.5 kg low in the middle: a straight line leaves -2/3 of that there, 1/3 at the ends.
    masses, bend = (0.0, 0.5, 1.0), 5e-3
    points = [
        CalibrationPoint(mass, 1e6 * (mass - (bend if mass == 0.5 else 0)), 1.0) for mass in masses
    ]
    found = calibrate(points)
    assert found.residuals == pytest.approx((bend / 3, -2 * bend / 3, bend / 3), rel=1e-9)
    assert found.counts_per_kg_uncertainty > 1000


def test_the_stated_uncertainties_are_those_of_repetitions():
    random = np.random.default_rng(5)
    masses, uncertain, sigma, slope = np.array([0.0, 0.2, 0.5, 1.0]), 2e-5, 4.0, 5e5
    found = []
    for _ in range(800):
        true = masses + uncertain * random.normal(size=4) * (masses > 0)
        readings = 100 + slope * true + sigma * random.normal(size=4)
        known = zip(masses, readings, [sigma] * 4, uncertain * (masses > 0), strict=True)
        found.append(calibrate([CalibrationPoint(*each) for each in known]))
    for name, uncertainty in (
        ('zero_counts', 'zero_uncertainty'),
        ('counts_per_kg', 'counts_per_kg_uncertainty'),
    ):
        seen = np.std([getattr(each, name) for each in found])
        # The smallest one stated is that of a fit that was not enlarged.
        assert seen == pytest.approx(min(getattr(each, uncertainty) for each in found), rel=0.12)


def test_what_a_load_at_rest_reads_is_known_as_well_as_its_slow_noise_allows():
    random = np.random.default_rng(7)
    white = random.normal(size=100_000)
    counts = np.round(50_000 + 20 * white).astype(np.int32)
    found = read_static(counts, *LIMITS)
    assert found.mean == pytest.approx(50_000, abs=0.3)
    assert found.std_error == pytest.approx(20 / math.sqrt(100_000), rel=0.6)
    assert found.noise == pytest.approx(20, rel=0.02)
    # The same spread, but slow: the mean of it is known far less well.
    slow = np.repeat(random.normal(size=100), 1000)
    wandering = read_static(np.round(50_000 + 20 * slow).astype(np.int32), *LIMITS)
    assert wandering.std_error == pytest.approx(20 / math.sqrt(100), rel=0.6)


def test_a_load_that_still_moves_is_not_stable():
    time = np.arange(2000) / 960
    creeping = read_static(np.round(1000 + 50 * time).astype(np.int32), *LIMITS)
    assert creeping.drift == pytest.approx(50 * 1000 / 960, rel=0.01)
    assert not creeping.is_stable(40.0)
    assert creeping.is_stable(60.0)
    still = read_static(np.full(2000, 1000, np.int32), *LIMITS)
    assert still.is_stable(0.0)


def test_a_new_zero_leaves_the_sensitivity():
    after = zero_only(CalibrationPoint(0.0, 1100.0, 0.0), 5e5)
    assert (after.zero_counts, after.counts_per_kg) == (1100.0, 5e5)
    assert after.zero_uncertainty == pytest.approx(1 / math.sqrt(12))
    assert math.isnan(after.counts_per_kg_uncertainty)


@pytest.mark.parametrize(
    ('points', 'message'),
    [
        ([], 'two different masses'),
        ([(0.5, 1.0, 1.0), (0.5, 2.0, 1.0)], 'two different masses'),
        ([(0.0, 100.0, 10.0), (1.0, 150.0, 10.0)], 'hardly differ'),
        ([(0.0, math.nan, 1.0), (1.0, 1e5, 1.0)], 'finite'),
        ([(0.0, 0.0, -1.0), (1.0, 1e5, 1.0)], 'negative'),
    ],
)
def test_points_that_determine_nothing_are_refused(points, message):
    with pytest.raises(CalibrationError, match=message):
        calibrate([CalibrationPoint(*point) for point in points])


def test_readings_that_cannot_be_are_refused():
    with pytest.raises(CalibrationError, match='50 samples are too few'):
        read_static(np.zeros(50, np.int32), *LIMITS)
    with pytest.raises(CalibrationError, match='at its limit'):
        read_static(np.full(200, LIMITS[1], np.int32), *LIMITS)
