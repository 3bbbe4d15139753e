# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Table 3 of the paper, compared with some of its cells and with means worked by hand."""

import math

import pytest

from checkweigher_validation.accuracy.paper_table import (
    PAPER_ESTIMATORS,
    PAPER_MASSES,
    PAPER_SPEEDS,
    paper_index,
    paper_result,
)


@pytest.mark.parametrize(
    ('estimator', 'speed', 'mass', 'std_dev', 'mean_error'),
    [
        ('tvlpf', 0.5, 0.0745, 0.031e-3, 0.048e-3),
        ('aid', 0.75, 0.2545, 0.149e-3, -0.055e-3),
        ('aeksi', 1.0, 0.1345, 0.101e-3, -0.089e-3),
        ('tvlpf', 1.25, 0.1645, 0.258e-3, 0.036e-3),
        ('iswd_eksi', 1.5, 0.1945, 0.157e-3, -0.005e-3),
    ],
)
def test_cells_are_those_of_the_paper(estimator, speed, mass, std_dev, mean_error):
    found = paper_result(estimator, speed, mass)

    assert found is not None
    assert found.std_dev == pytest.approx(std_dev)
    assert found.mean_error == pytest.approx(mean_error)
    assert found.index == pytest.approx(abs(mean_error) + 3 * std_dev)


def test_there_is_a_cell_for_each_estimator_speed_and_mass():
    cells = [
        paper_result(estimator, speed, mass)
        for estimator in PAPER_ESTIMATORS
        for speed in PAPER_SPEEDS
        for mass in PAPER_MASSES
    ]

    assert None not in cells
    # Sums over the 25 cells of each algorithm, in mg: a slip of a digit shows.
    sums = [sum(round(1e6 * one.std_dev) for one in cells[n : n + 25]) for n in range(0, 100, 25)]
    assert sums == [3910, 3301, 2911, 2392]


def test_the_mean_index_is_that_worked_by_hand():
    # ISWD-EKSI at 30 m/min: sigma .029 .038 .028 .041 .033, sum .169; |mu| .039 .033 .013 .002
    # .024, sum .111.
    assert paper_index('iswd_eksi', 0.5) == pytest.approx((0.111 + 3 * 0.169) / 5 * 1e-3)
    means = [paper_index('aeksi', speed) for speed in PAPER_SPEEDS]
    assert paper_index('aeksi') == pytest.approx(sum(means) / 5)


def test_what_the_paper_does_not_have_is_not_made_up():
    assert paper_result('hann', 1.0, 0.1645) is None
    assert paper_result('aid', 0.9, 0.1645) is None
    assert paper_result('aid', 1.0, 0.1) is None
    assert math.isnan(paper_index('hann'))
    assert math.isnan(paper_index('aid', 0.9))
