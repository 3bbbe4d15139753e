# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Choice of a tuned estimator and its reason, from held-out errors made by hand."""

import numpy as np
import pytest

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.tuning.calibration import Calibration, Uncertainty
from checkweigher_validation.tuning.choice import choose
from checkweigher_validation.tuning.tuner import Tuned, TunedSpeed

PASSES = 100


def tuned(name, *errors):
    """Return a tuned estimator with the held-out errors of passes at each speed, in kg."""
    speeds = tuple(
        TunedSpeed(
            speed, len(each), {}, Calibration(1.0, 0.0), Uncertainty(0.0, 0.0), 0.0, 0.0,
            held_out_errors=tuple(each), masses=(0.1, 0.2) * (len(each) // 2),
        )
        for speed, each in enumerate(errors, start=1)
    )  # fmt: skip
    return name, Tuned(name, speeds, LineParameters())


@pytest.fixture
def noise():
    """Return errors of all estimators, and additional errors of one estimator, 1 mg each."""
    return 1e-6 * np.random.default_rng(8).standard_normal((4, PASSES))


def test_the_smallest_index_on_held_out_passes_is_chosen(noise):
    assert choose(dict([tuned('hann', 2 * noise[0]), tuned('learned', noise[0])])) == (
        'learned',
        'learned: smallest A on held-out passes; that of hann is larger by 100 % +- 0 %',
    )


def test_a_simpler_one_is_chosen_where_it_loses_next_to_nothing(noise):
    assert choose(dict([tuned('learned', noise[0]), tuned('hann', 1.03 * noise[0])])) == (
        'hann',
        'hann: simpler than learned, whose A is smaller by a negligible amount, 3 % +- 0 %',
    )


@pytest.mark.parametrize(
    ('hann', 'passes', 'chosen'),
    [
        pytest.param(lambda a, b: 1.02 * b, PASSES, 'learned', id='cannot be told apart'),
        # 8 % more of the same: as clear as it is small.
        pytest.param(lambda a, b: 1.08 * a, PASSES, 'learned', id='disturbed alike'),
        pytest.param(lambda a, b: a, PASSES, 'hann', id='no worse'),
        pytest.param(lambda a, b: 10 * b, 4, 'learned', id='few passes'),
    ],
)
def test_the_simpler_one_needs_passes_that_show_it_to_be_as_good(noise, hann, passes, chosen):
    one, other = noise[0] / np.std(noise[0]), noise[1] / np.std(noise[1])
    tables = [tuned('learned', one[:passes]), tuned('hann', hann(one, other)[:passes])]
    assert choose(dict(tables))[0] == chosen


def test_a_factor_counts_the_same_at_a_slow_and_at_a_fast_belt(noise):
    # Twice as good where all is small, a third worse where all is large.
    hann = tuned('hann', noise[0], 300 * noise[1])
    learned = tuned('learned', noise[0] / 2, 400 * noise[1])
    assert choose(dict([hann, learned]))[0] == 'learned'


def test_the_standard_error_is_that_of_the_errors_of_many_machines():
    # Standard deviations of 100 passes scatter by 1 / sqrt(200), the ratio of two by 10 %.
    random = np.random.default_rng(9)
    reasons = [
        choose(
            dict(tuned(name, 1e-6 * random.standard_normal(PASSES)) for name in ('hann', 'learned'))
        )[1]
        for _ in range(100)
    ]
    stated = [float(reason.split()[-2]) for reason in reasons]
    assert 9 < np.mean(stated) < 11
    # By the mean error, a part of A, it is a little more.
    assert 0.5 < np.mean([float(reason.split()[-5]) for reason in reasons]) / np.mean(stated) < 1.2


@pytest.mark.parametrize(
    ('factor', 'chosen'),
    [(0.5, 'learned'), pytest.param(0.97, 'untrained', id='within the standard error')],
)
def test_the_default_stays_unless_another_is_clearly_better(noise, factor, chosen):
    # 20 passes tell standard deviations apart by some 20 %.
    found = [tuned('untrained', noise[0][:20]), tuned('learned', factor * noise[1][:20])]
    assert choose(dict(found))[0] == chosen


def test_one_alone_is_chosen(noise):
    assert choose(dict([tuned('mean', noise[0])]))[0] == 'mean'
