# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results of a recording in parts, and the summary below a table of items."""

from dataclasses import astuple
import itertools
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from spoilt_lines import CELL, make_line, plans

from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS, Reference
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.signal.averages import RunningMoments
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate
from checkweigher_validation.accuracy.columns import rows_as_csv
from checkweigher_validation.accuracy.results import weigh, weigh_stretches

MEAN = LineParameters().with_estimator('mean')


def test_a_text_that_a_spreadsheet_would_calculate_is_written_as_text():
    rows = [['=HYPERLINK("x")', '@a', '-1+1', '+x'], ['-0.25', '+1e-3', 'a=b', -2.5, None]]
    assert list(rows_as_csv(rows)) == [
        '"\'=HYPERLINK(""x"")",\'@a,\'-1+1,\'+x\n',
        '-0.25,+1e-3,a=b,-2.5,\n',
    ]


def stretches(recording, seconds):
    """Return the parts of a recording, with durations in s that are used in turn."""
    begin = recording.blocks[0].stamp
    end = max(event.stamp for event in recording) + 1
    bounds = [-math.inf, begin + 1]  # the first one has a block
    for length in itertools.cycle(seconds):
        if bounds[-1] >= end:
            break
        bounds.append(bounds[-1] + round(length * NANOSECONDS))
    return [
        Recording.from_events(
            recording.load_cell, (event for event in recording if first <= event.stamp < last)
        )
        for first, last in itertools.pairwise(bounds)
    ]


def plain(results):
    """Return results in a form in which NaN equals NaN."""
    return [repr(astuple(result)) for result in results]


@pytest.mark.parametrize('seconds', [[0.01], [0.3, 1.0], [5.0], [1000.0]])
@pytest.mark.parametrize('estimator', ['iswd_eksi', 'mean'])
def test_stretches_have_the_results_of_the_whole_to_the_bit(seconds, estimator):
    recording = simulate(SimulationParameters(count=12, speed=1.5))
    parameters = LineParameters().with_estimator(estimator)

    results = list(weigh_stretches(stretches(recording, seconds), parameters))

    assert plain(results) == plain(weigh(recording, parameters))
    assert len(results) == 12
    assert all(result.t4 and result.reference > 0 for result in results)


@given(plans(), st.lists(st.floats(0.02, 3.0), min_size=1, max_size=3))
def test_stretches_of_a_spoilt_line_have_the_results_of_the_whole(plan, seconds):
    line = make_line(plan)
    known = [
        Reference(truth['t1'], product.mass)
        for product, truth in zip(line.products, line.truth, strict=True)
        if 't1' in truth
    ]
    events = [event for _, event in line.events]
    recording = Recording.from_events(CELL, [*events, *known])

    results = weigh_stretches(stretches(recording, seconds), MEAN)

    assert plain(results) == plain(weigh(recording, MEAN))


def test_errors_are_summed_without_being_kept():
    errors = np.random.default_rng(3).normal(0.1, 2.0, 1000).tolist()
    found = RunningMoments()

    for error in errors:
        found.add(error)

    assert found.count == 1000
    assert (found.mean, found.std_dev) == pytest.approx((np.mean(errors), np.std(errors, ddof=1)))
    assert found.largest == max(errors, key=abs)
