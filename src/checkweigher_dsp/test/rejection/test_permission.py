# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rule by which the line may run."""

import pytest

from checkweigher_core.health.findings import Level
from checkweigher_core.records import StreamState, StreamStatus
from checkweigher_dsp.rejection.permission import PermissionRule

MS = 1_000_000
STAGES = ('denoise', 'identifier')
THERE = dict.fromkeys(('eyes', 'load cell'), True)


def rule(*, deadlines=True):
    """Return the rule of a line that weighs since 0 ms."""
    made = PermissionRule(0.3, STAGES, deadlines=deadlines)
    progress(made, 100, 0)
    for stage in STAGES:
        made.add_sign(stage, 0)
    return made


def progress(made, samples, ms, stream=1):
    made.add_progress(StreamStatus(0, stream, StreamState.RUNNING, samples), ms * MS)


def may_run(made, ms, *, stopped=False, **changed):
    return made.may_run({**THERE, **changed}, ms * MS, stopped=stopped)


def test_the_line_may_run_while_all_is_fresh_and_no_stop_is_requested():
    made = rule()
    assert may_run(made, 300)
    assert made.finding().text == 'given'
    assert not may_run(made, 300, stopped=True)
    assert (made.finding().level, made.finding().text) == (Level.OK, 'withdrawn')


@pytest.mark.parametrize('name', THERE)
def test_without_a_part_of_the_line_it_may_not(name):
    made = rule()
    assert not may_run(made, 0, **{name: False})
    assert (made.finding().level, made.finding().text) == (Level.WARN, f'withdrawn: no {name}')
    assert may_run(made, 0)


@pytest.mark.parametrize('name', STAGES)
def test_it_runs_out_with_the_signs_of_a_stage(name):
    made = rule()
    progress(made, 200, 200)
    made.add_sign(*{'denoise', 'identifier'} - {name}, 200 * MS)
    assert made.fresh_for(290 * MS) == 10 * MS
    assert may_run(made, 300)
    assert not may_run(made, 301)
    assert (made.finding().level, made.finding().text) == (Level.WARN, f'withdrawn: no {name}')
    made.add_sign(name, 400 * MS)
    assert may_run(made, 400)


def test_samples_are_fresh_by_their_progress_alone():
    made = PermissionRule(0.3, deadlines=True)
    progress(made, 0, 0)  # a stream that is announced
    assert not may_run(made, 0)
    progress(made, 100, 10)
    progress(made, 100, 200)  # the driver has asked
    assert may_run(made, 310)
    assert [made.fresh_for(ms * MS) for ms in (10, 300, 320)] == [300 * MS, 10 * MS, 0]
    assert not may_run(made, 311)
    assert made.finding().text == 'withdrawn: no samples'
    progress(made, 100, 400, stream=2)
    assert may_run(made, 700)


def test_without_deadlines_nothing_runs_out():
    made = rule(deadlines=False)
    assert may_run(made, 10_000, eyes=False)
    assert made.finding().text == 'given'
    assert not may_run(made, 0, stopped=True)
