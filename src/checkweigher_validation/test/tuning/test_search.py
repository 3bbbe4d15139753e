# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Search for the minima of functions whose minimum is known."""

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_dsp.estimation.estimators.base import Axis
from checkweigher_validation.tuning.search import BUDGET, search, start_position, value_at

PLACE = 0.01  # by which a place may be missed, of the length of its axis
UNIT_CUBE = tuple(Axis(name, 0.0, 1.0, 0.5) for name in 'abc')


class Bowl:
    """Squared distance from a point in the coordinates of the search, with a count of its calls."""

    def __init__(self, axes, **place):
        self.axes = axes
        self.place = place
        self.calls = []

    def distance(self, values):
        return {
            axis.name: (
                math.log(values[axis.name] / self.place[axis.name]) / math.log(axis.high / axis.low)
                if axis.logarithmic
                else (values[axis.name] - self.place[axis.name]) / (axis.high - axis.low)
            )
            for axis in self.axes
        }

    def __call__(self, values):
        self.calls.append(dict(values))
        return sum(distance**2 for distance in self.distance(values).values())


def test_the_bottom_of_a_bowl_is_found():
    bowl = Bowl(UNIT_CUBE, a=0.3, b=0.72, c=0.08)
    values, badness = search(UNIT_CUBE, bowl)
    assert values == pytest.approx({'a': 0.3, 'b': 0.72, 'c': 0.08}, abs=PLACE)
    assert badness == bowl(values)


def test_a_whole_number_and_a_logarithmic_axis_are_found_beside_a_plain_one():
    axes = (
        Axis('order', 1, 8, 2, whole=True),
        Axis('cutoff', 0.01, 1000.0, 1.0, logarithmic=True),
        Axis('gain', -2.0, 2.0, 0.0),
    )
    bowl = Bowl(axes, order=6, cutoff=50.0, gain=1.1)
    values, _ = search(axes, bowl)
    assert values['order'] == 6
    assert max(map(abs, bowl.distance(values).values())) < PLACE
    assert all(call['order'] == int(call['order']) for call in bowl.calls)


def test_of_two_bowls_the_deeper_one_is_found_though_the_start_is_in_the_other():
    shallow = Bowl(UNIT_CUBE, a=0.5, b=0.5, c=0.5)
    deep = Bowl(UNIT_CUBE, a=0.9, b=0.9, c=0.1)
    values, _ = search(UNIT_CUBE, lambda values: min(shallow(values) + 0.1, deep(values)))
    assert values == pytest.approx({'a': 0.9, 'b': 0.9, 'c': 0.1}, abs=PLACE)


@pytest.mark.parametrize('budget', [1, 2, 5, 17, 60, BUDGET])
@pytest.mark.parametrize('count', [1, 2, 3])
def test_the_budget_is_kept_to_a_simplex(budget, count):
    axes = UNIT_CUBE[:count]
    bowl = Bowl(axes, a=0.3, b=0.72, c=0.08)
    search(axes, bowl, budget)
    assert 1 <= len(bowl.calls) <= budget + count + 1
    if budget >= 17:
        assert len(bowl.calls) >= budget - count - 1


def test_the_start_is_tried_first_and_nothing_is_worse():
    axes = (*UNIT_CUBE, Axis('d', 0.1, 480.0, 37.5, logarithmic=True))
    start = {'a': 0.5, 'b': 0.5, 'c': 0.5, 'd': 37.5}
    bowl = Bowl(axes, a=0.3, b=0.72, c=0.08, d=1.0)
    search(axes, bowl, 20)
    assert bowl.calls[0] == start
    # A needle at the start and nothing anywhere else.
    assert search(axes, lambda values: float(values != start), 40) == (start, 0.0)


def test_without_axes_there_is_one_evaluation():
    calls = []
    assert search((), lambda values: calls.append(values) or 0.25) == ({}, 0.25)
    assert calls == [{}]


@pytest.mark.filterwarnings('error')
def test_where_an_estimator_fails_the_search_goes_elsewhere():
    bowl = Bowl(UNIT_CUBE, a=0.3, b=0.72, c=0.08)
    values, badness = search(
        UNIT_CUBE, lambda values: bowl(values) if values['a'] < 0.45 else math.inf
    )
    assert badness < 1e-3
    assert values == pytest.approx({'a': 0.3, 'b': 0.72, 'c': 0.08}, abs=3 * PLACE)


@pytest.mark.filterwarnings('error')
def test_where_it_fails_everywhere_badness_is_infinite():
    assert search(UNIT_CUBE, lambda values: math.inf, 30)[1] == math.inf


AXES = st.one_of(
    st.builds(
        lambda low, span, share, whole: Axis(
            'x', low, low + span, low + (round(share * span) if whole else share * span),
            whole=whole,
        ),
        st.integers(-50, 50), st.integers(1, 100), st.floats(0, 1), st.booleans(),
    ),
    st.builds(
        lambda low, factor, share: Axis(
            'x', low, low * factor, low * factor**share, logarithmic=True
        ),
        st.floats(1e-6, 1e3), st.floats(1.5, 1e6), st.floats(0, 1),
    ),
)  # fmt: skip


@given(AXES)
def test_the_position_of_the_start_is_the_start(axis):
    assert value_at(axis, start_position(axis)) == pytest.approx(
        axis.start, rel=1e-4, abs=1e-4 * (axis.high - axis.low)
    )


@given(AXES, st.floats(-0.5, 1.5), st.floats(-0.5, 1.5))
def test_values_ascend_with_the_position_and_stay_on_the_axis(axis, one, other):
    low, high = sorted((one, other))
    assert axis.low <= value_at(axis, low) <= value_at(axis, high) <= axis.high
