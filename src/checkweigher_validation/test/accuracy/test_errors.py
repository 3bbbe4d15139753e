# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Statistics of errors against numbers worked by hand and against the statistics module."""

import math
import statistics

from hypothesis import given
from hypothesis import strategies as st
from made_evaluations import make_condition
import numpy as np
import pytest

from checkweigher_validation.accuracy.errors import Evaluation, Example, average, coverage, distinct

EXACT = 1e-12  # relative


def test_statistics_of_four_errors_are_those_worked_by_hand():
    # Mean 1.5 mg; deviations -2.5, -0.5, 0.5, 2.5 mg, squares 13, over 3.
    one = make_condition([-1e-6, 1e-6, 2e-6, 4e-6], bound=1e-6)

    assert make_condition([1e-6, -1e-6, -2e-6, -4e-6]).index == pytest.approx(one.index, rel=EXACT)
    assert one.count == 4
    assert one.mean_error == pytest.approx(1.5e-6, rel=EXACT)
    assert one.std_dev == pytest.approx(math.sqrt(13 / 3) * 1e-6, rel=EXACT)
    assert one.index == pytest.approx((1.5 + 3 * math.sqrt(13 / 3)) * 1e-6, rel=EXACT)
    assert one.ratio == pytest.approx(math.sqrt(13 / 3), rel=EXACT)


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=30))
def test_mean_and_standard_deviation_agree_with_the_statistics_module(errors):
    one = make_condition(errors)

    assert one.mean_error == pytest.approx(statistics.fmean(errors), abs=1e-12)
    assert one.std_dev == pytest.approx(statistics.stdev(errors), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize('errors', [[], [1e-3]])
def test_fewer_than_two_weighed_passes_have_no_standard_deviation(errors):
    one = make_condition(errors, bound=1e-3, faults=3)

    assert math.isnan(one.std_dev)
    assert math.isnan(one.index)
    assert math.isnan(one.ratio)
    assert one.faults == 3
    # Without a bound there is no ratio either.
    assert math.isnan(make_condition([0.0, 1.0]).ratio)
    assert math.isnan(make_condition([0.0, 1.0], bound=0.0).ratio)


def test_coverage_counts_the_errors_within_the_stated_interval():
    # 95 % is +-1.96 standard deviations of 0.1 g each: 0.1, 0.19 are in, 0.2 and 0.3 g are out.
    one = make_condition([1e-4, -1.9e-4, 2e-4, -3e-4])

    assert coverage([one], 0.95) == 0.5
    assert coverage([one], 0.68) == 0.0  # 0.9945 standard deviations
    assert coverage([one], 0.69) == 0.25  # 1.0152
    # Passes that state no standard deviation are left out.
    some = make_condition([0.0, 1.0, 1.0], std_devs=[1e-4, math.nan, math.nan])
    assert coverage([some], 0.95) == 1.0
    assert math.isnan(coverage([make_condition([0.0], std_devs=[math.nan])], 0.95))
    # Each pass counts once: one of one and none of three.
    pair = [make_condition([0.0]), make_condition([1.0, 1.0, 1.0], mass=0.1)]
    assert coverage(pair, 0.95) == 0.25
    assert math.isnan(coverage([], 0.95))


@pytest.fixture
def evaluation():
    return Evaluation(
        'two estimators',
        tuple(
            make_condition([0.0, 2 * number * 1e-3], name, speed, mass, part, bound=1e-3)
            for number, name in ((1, 'tvlpf'), (2, 'aid'))
            for speed in (1.5, 0.5)
            for mass in (0.2545, 0.0745)
            for part in ('train', 'test')
        ),
        (('seed', '1'),),
    )


def test_an_evaluation_names_what_it_holds(evaluation):
    assert evaluation.estimators == ('tvlpf', 'aid')
    assert evaluation.speeds == (0.5, 1.5)
    assert evaluation.masses == (0.0745, 0.2545)
    assert evaluation.parts == ('test', 'train')


def test_select_takes_what_agrees_with_all_that_is_given(evaluation):
    assert len(evaluation.select()) == 16
    assert len(evaluation.select(estimator='aid', part='test')) == 4
    (one,) = evaluation.select(estimator='aid', part='test', speed=1.5 + 1e-9, mass=0.2545)
    assert (one.estimator, one.part, one.speed, one.mass) == ('aid', 'test', 1.5, 0.2545)
    assert evaluation.select(speed=1.0) == ()


def test_averages_weigh_each_condition_alike(evaluation):
    # Errors 0 and 2k g: mean k g, standard deviation k sqrt(2) g, for k = 1 and 2.
    both = average(evaluation.select(speed=0.5, mass=0.0745, part='test'))
    assert both.mean_error == pytest.approx(1.5e-3, rel=EXACT)
    assert both.std_dev == pytest.approx(1.5e-3 * math.sqrt(2), rel=EXACT)
    assert both.index == pytest.approx(1.5e-3 * (1 + 3 * math.sqrt(2)), rel=EXACT)
    assert both.ratio == pytest.approx(1.5 * math.sqrt(2), rel=EXACT)
    assert (both.count, both.faults) == (4, 0)

    # Mean errors of different signs do not cancel.
    pair = [make_condition([1.0, 1.0]), make_condition([-1.0, -1.0], mass=0.1, faults=2)]
    assert average(pair).mean_error == 1.0
    assert average(pair).faults == 2


def test_a_condition_without_a_value_leaves_the_average_without_one():
    there, lacking = make_condition([0.0, 1.0]), make_condition([], mass=0.1, faults=60)

    assert math.isnan(average([there, lacking]).index)
    assert average([there, lacking]).faults == 60
    assert math.isnan(average([]).index)


def test_values_that_differ_by_rounding_are_one():
    assert distinct([1.5, 0.1 + 0.2, 0.3, 0.75]) == pytest.approx((0.3, 0.75, 1.5))


def test_the_window_of_an_example_goes_from_t2_to_the_last_sample_before_t3():
    def example(t2, t3):
        return Example(1.0, 0.1, 1000.0, 0.0, t2, t3, 0.2, np.zeros(100), np.zeros(0))

    # A sample on t2 is in the window, one on t3 is not.
    assert example(0.010, 0.020).window == slice(10, 20)
    assert example(0.0101, 0.0201).window == slice(11, 21)
    assert example(0.0, 0.5).window == slice(0, 100)
    # 0.07 * 1000 is 70.00000000000001.
    assert example(0.07, 0.09).window == slice(70, 90)
