# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reference test by both sampling plans, against their tables and numbers worked by hand."""

import math

import numpy as np
import pytest
from scipy.stats import hypergeom
from scipy.stats import t as student

from checkweigher_production.reference_method import SamplingPlan, reference_test

# 100 g: TU1 95.5 g, TU2 91 g.
GOOD, DEFECTIVE, FAR_BELOW = 0.101, 0.0954, 0.0905


@pytest.mark.parametrize(
    ('size', 'first', 'accept', 'reject', 'both', 'accept_both', 'mean_count', 'k'),
    [
        (100, 30, 1, 3, 60, 4, 30, 0.503),
        (500, 30, 1, 3, 60, 4, 30, 0.503),
        (501, 50, 2, 5, 100, 6, 50, 0.379),
        (3_200, 50, 2, 5, 100, 6, 50, 0.379),
        (3_201, 80, 3, 7, 160, 8, 50, 0.379),
    ],
)
def test_the_plan_is_that_of_the_directive(
    size: int, first: int, accept: int, reject: int, both: int, accept_both: int,
    mean_count: int, k: float,
):  # fmt: skip
    found = reference_test([GOOD] * size, 0.1)
    sample = found.samples[0]
    assert (len(found.samples), sample.count, sample.accept, sample.reject) == (
        1, first, accept, reject,
    )  # fmt: skip
    assert (found.mean_count, found.k, found.passed) == (mean_count, k, True)
    assert k == pytest.approx(student.ppf(0.995, mean_count - 1) / math.sqrt(mean_count), abs=5e-4)

    # One more than the first sample may have, and then more from the second one.
    order = reference_test([GOOD] * size, 0.1, seed=7).drawn
    few = np.full(size, GOOD)
    few[list(order[: accept + 1])] = DEFECTIVE
    found = reference_test(few, 0.1, seed=7)
    assert [each.count for each in found.samples] == [first, both]
    assert (found.samples[1].defective, found.samples[1].accept) == (accept + 1, accept_both)
    assert found.contents_passed
    few[list(found.drawn[first : first + accept_both - accept])] = DEFECTIVE
    found = reference_test(few, 0.1, seed=7)
    assert found.samples[1].defective == accept_both + 1
    assert not found.contents_passed
    few[list(order[:reject])] = DEFECTIVE
    found = reference_test(few, 0.1, seed=7)
    assert [each.count for each in found.samples] == [first]
    assert not found.contents_passed


@pytest.mark.parametrize(
    ('size', 'count', 'accept', 'k'),
    [
        (100, 50, 3, 0.379),
        (500, 50, 3, 0.379),
        (501, 80, 5, 0.295),
        (3_200, 80, 5, 0.295),
        (3_201, 125, 7, 0.234),
    ],
)
def test_single_sampling_decides_by_one_sample(size: int, count: int, accept: int, k: float):
    def tested(masses: np.ndarray):
        return reference_test(masses, 0.1, seed=7, plan=SamplingPlan.SINGLE)

    masses = np.full(size, GOOD)
    found = tested(masses)
    assert (len(found.drawn), found.mean_count, found.k, found.passed) == (count, count, k, True)
    assert k == pytest.approx(student.ppf(0.995, count - 1) / math.sqrt(count), abs=5e-4)
    order = list(found.drawn)
    masses[order[:accept]] = DEFECTIVE
    assert tested(masses).contents_passed
    masses[order[0]] = FAR_BELOW  # below TU2: one is too many
    assert not tested(masses).contents_passed
    masses[order[: accept + 1]] = DEFECTIVE
    found = tested(masses)
    assert [(each.count, each.reject) for each in found.samples] == [(count, accept + 1)]
    assert not found.contents_passed


def test_single_sampling_agrees_with_published_examples():
    # Guide to the Average Quantity System in Australia, Table 3: 125 of 3,500 packs of butter of
    # 500 g, two of them between 470 g and 485 g; 50 of 148 bags of potatoes of 3 kg, one below
    # 2.91 kg; each mean is above nominal.
    drawn = reference_test([0.5] * 3_500, 0.5, plan=SamplingPlan.SINGLE).drawn
    butter = np.full(3_500, 0.5015)
    butter[list(drawn[:2])] = 0.484
    assert reference_test(butter, 0.5, plan=SamplingPlan.SINGLE).passed
    drawn = reference_test([3.0] * 148, 3.0, plan=SamplingPlan.SINGLE).drawn
    potatoes = np.full(148, 3.1)
    potatoes[drawn[0]] = 2.9
    found = reference_test(potatoes, 3.0, plan=SamplingPlan.SINGLE)
    assert (len(found.drawn), found.mean_passed, found.contents_passed) == (50, True, False)


def test_the_mean_is_held_to_a_limit_that_its_spread_lowers():
    # Half at 98 g, half at 101.8 g: mean 99.9 g. 30 drawn have s of about 1.93 g.
    masses = [0.098, 0.1018] * 50
    found = reference_test(masses, 0.1, seed=3)
    drawn = np.array(masses)[list(found.drawn)]
    ups = int(np.sum(drawn == 0.1018))
    mean = (98 * (30 - ups) + 101.8 * ups) / 30
    variance = (ups * (101.8 - mean) ** 2 + (30 - ups) * (98 - mean) ** 2) / 29
    assert found.mean == pytest.approx(1e-3 * mean, rel=1e-12)
    assert found.std_dev == pytest.approx(1e-3 * math.sqrt(variance), rel=1e-9)
    assert found.mean_limit == pytest.approx(0.1 - 0.503 * found.std_dev, rel=1e-12)
    assert found.mean_passed == (found.mean >= found.mean_limit)
    assert not reference_test([0.0999] * 100, 0.1).mean_passed  # without spread, by 0.1 g


def test_a_batch_below_a_hundred_is_tested_whole():
    # UK SI 2006/659, schedule 2, 3.6: at most 5 % are defective.
    for size, accept in ((19, 0), (20, 1), (40, 2), (99, 4)):
        found = reference_test([DEFECTIVE] * accept + [GOOD] * (size - accept), 0.1)
        assert (found.drawn, found.samples[0].accept) == (tuple(range(size)), accept)
        assert found.contents_passed
        more = reference_test([DEFECTIVE] * (accept + 1) + [GOOD] * (size - accept - 1), 0.1)
        assert not more.contents_passed
    assert (found.mean_limit, found.passed) == (0.1, True)
    assert not reference_test([FAR_BELOW, *[GOOD] * 78], 0.1).contents_passed
    assert not reference_test([0.0999] * 99, 0.1).mean_passed


def test_the_draw_is_fair_and_its_own_for_each_seed():
    # 60 of 1000 defective: the number in the first 50 is hypergeometric, with the mean 3.
    masses = np.array([DEFECTIVE] * 60 + [GOOD] * 940)
    found = [reference_test(masses, 0.1, seed) for seed in range(400)]
    first = [int(np.sum(masses[list(each.drawn[:50])] == DEFECTIVE)) for each in found]
    law = hypergeom(1000, 60, 50)
    assert np.mean(first) == pytest.approx(law.mean(), abs=4 * law.std() / math.sqrt(400))
    assert found[5] == reference_test(masses, 0.1, 5)


@pytest.mark.parametrize('masses', [[], [0.1, math.nan]])
def test_a_batch_that_cannot_be_tested_is_refused(masses: list[float]):
    with pytest.raises(ValueError, match=r'batch of no|not finite'):
        reference_test(masses, 0.1)
