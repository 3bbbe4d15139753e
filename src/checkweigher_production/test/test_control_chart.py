# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The control chart against constants of the standard and rules worked by hand."""

import numpy as np
import pytest

from checkweigher_production.control_chart import SUBGROUP, control_chart

A3, B4 = 1.427, 2.089  # of five values: ISO 7870-2, table 2


def chart_of(means: list[float]) -> list[str]:
    """Return the marks of subgroups with these means, each from -1 to 1 around it."""
    spread = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    found = control_chart(np.concatenate([mean + spread for mean in means]).tolist())
    return list(found.marks)


def test_limits_are_those_of_the_standard():
    random = np.random.default_rng(1)
    masses = 0.15 + 1e-3 * random.standard_normal(40 * SUBGROUP)
    found = control_chart(masses.tolist())
    groups = masses.reshape(-1, SUBGROUP)
    spread = np.std(groups, axis=1, ddof=1).mean()
    assert found.centre == pytest.approx(masses.mean())
    assert found.upper - found.centre == pytest.approx(A3 * spread, rel=1e-3)
    assert found.centre - found.lower == pytest.approx(A3 * spread, rel=1e-3)
    assert found.spread_upper == pytest.approx(B4 * spread, rel=1e-3)


@pytest.mark.parametrize(
    ('means', 'mark'),
    [
        ([0.0] * 5 + [3.0], 'beyond the limits'),
        ([-0.2] * 4 + [0.2, -0.2] + [0.2] * 7, '7 on one side'),
        ([0, -0.3, -0.2, -0.1, 0, 0.1, 0.2, 0.3], '7 rising'),
        ([0, 0.3, 0.2, 0.1, 0, -0.1, -0.2, -0.3], '7 falling'),
    ],
)
def test_the_mean_that_breaks_a_rule_is_marked(means: list[float], mark: str):
    *before, last = chart_of(means)
    assert last == mark
    assert not any(before)


def test_limits_are_those_of_the_reference_period():
    calm, later = [0.1, 0.102, 0.098, 0.1, 0.1] * 4, [0.2, 0.202, 0.198, 0.2, 0.2] * 4
    found, alone = control_chart(calm + later, calm), control_chart(calm)
    assert (found.centre, found.upper, found.spread) == (alone.centre, alone.upper, alone.spread)
    # The run of means beyond the limits has one mark.
    assert found.marks == ('', '', '', '', 'beyond the limits', '', '', '')


def test_items_that_fill_no_second_subgroup_make_no_chart():
    assert control_chart([0.1] * (2 * SUBGROUP - 1)) is None
