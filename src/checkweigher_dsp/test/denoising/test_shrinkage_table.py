# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Table 1 as it is printed, and the interpolation between its columns."""

import numpy as np
import pytest

from checkweigher_dsp.denoising.shrinkage_table import TABLE_1, ShrinkageTable

ROUNDING = 1e-12

# m/min: gamma5, gamma6, gamma7, lambda5, lambda6, lambda7, as printed.
PRINTED = {
    30: (0.080, 0.385, 0.850, 150, 14, 3),
    45: (0.040, 0.351, 0.847, 130, 13, 3),
    60: (0.110, 0.580, 0.856, 350, 40, 4),
    75: (0.080, 0.523, 0.789, 220, 26, 4),
    90: (0.100, 0.590, 0.860, 260, 30, 5),
}
SMALL = ShrinkageTable(
    speeds=(1.0, 2.0, 4.0),
    gains=((0.1, 0.3, 0.4), (0.5, 0.5, 0.7), (1.0, 0.8, 0.0)),
    thresholds=((10.0, 30.0, 40.0), (5.0, 5.0, 7.0), (1.0, 0.8, 0.0)),
)


@pytest.mark.parametrize('speed', PRINTED)
def test_table_1_has_the_printed_numbers(speed):
    printed = PRINTED[speed]
    shrinkages = TABLE_1.at(speed / 60, unit=1.0)
    assert shrinkages[:4] == (None,) * 4
    assert [band.gain for band in shrinkages[4:]] == pytest.approx(printed[:3], rel=ROUNDING)
    assert [band.threshold for band in shrinkages[4:]] == pytest.approx(printed[3:], rel=ROUNDING)


@pytest.mark.parametrize(
    ('speed', 'gain', 'threshold'),
    [
        (0.01, 0.1, 10.0),
        (1.0, 0.1, 10.0),
        (1.25, 0.15, 15.0),
        (3.5, 0.375, 37.5),
        (4.001, 0.4, 40.0),
    ],
)
def test_the_table_is_linear_between_its_speeds_and_constant_outside(speed, gain, threshold):
    for unit in (1.0, 1e-3):
        band = SMALL.at(speed, unit)[4]
        assert (band.gain, band.threshold) == pytest.approx((gain, unit * threshold), rel=ROUNDING)


def test_one_speed_is_a_table():
    table = ShrinkageTable((1.0,), ((7.0,),) * 3, ((3.0,),) * 3)
    for speed in (0.5, 1.0, 2.0):
        assert (table.at(speed, 1.0)[4].gain, table.at(speed, 1.0)[4].threshold) == (7.0, 3.0)


def test_several_speeds_give_a_row_for_each_window():
    speeds = np.array([[0.5], [1.25], [3.5], [9.0]])

    band = SMALL.at(speeds, unit=2.0)[5]

    each = [SMALL.at(float(speed), unit=2.0)[5] for speed in speeds[:, 0]]
    assert band.gain.shape == (4, 1)
    np.testing.assert_allclose(band.gain[:, 0], [one.gain for one in each], rtol=ROUNDING)
    np.testing.assert_allclose(band.threshold[:, 0], [one.threshold for one in each], rtol=ROUNDING)
