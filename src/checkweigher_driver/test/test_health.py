# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the driver tells of a source that runs, is held back, ends or fails."""

import pytest

from checkweigher_core.health.findings import Level
from checkweigher_core.records import NANOSECONDS
from checkweigher_driver.health import DriverWatch
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate


@pytest.fixture
def running():
    """Return a driver that has sent a line of 3 products in real time, and the time of its end."""
    line = simulate(SimulationParameters(count=3))
    watch = DriverWatch('simulator')
    watch.begin(line.load_cell, 100.0)
    begin, now = line.blocks[0].stamp, 100.0
    for event in sorted([*line.blocks, *line.edges], key=lambda event: event.stamp):
        now = 100.0 + (event.stamp - begin) / NANOSECONDS
        watch.add(now, event)
    return watch, now


def findings(watch, now, trouble='', **figures):
    return watch.findings(now, 0.0, trouble, figures)


def levels(watch, now):
    return {finding.aspect: finding.level for finding in findings(watch, now)}


def test_a_source_that_runs_is_well_and_has_its_figures(running):
    watch, now = running
    assert set(levels(watch, now).values()) == {Level.OK}
    source, samples, _, eyes = findings(watch, now)
    assert (source.values['source'], source.values['state']) == ('simulator', 'running')
    assert samples.values['received_samples_per_s'] == pytest.approx(960.0, rel=1e-3)
    assert (eyes.values['infeed_edges'], eyes.values['outfeed_edges']) == (6, 6)


def test_a_source_that_hangs_is_an_error(running):
    watch, now = running
    assert levels(watch, now + 5.0)['Samples'] == Level.ERROR


def test_a_source_that_is_held_back_or_has_ended_owes_no_samples(running):
    watch, now = running
    watch.waits_for = 'a segmenter'
    later = levels(watch, now + 60.0)
    assert (later['Source'], later['Samples']) == (Level.WARN, Level.OK)
    watch.end()
    later = levels(watch, now + 60.0)
    assert (later['Source'], later['Samples']) == (Level.OK, Level.OK)


@pytest.mark.parametrize(
    ('change', 'trouble', 'level', 'text', 'hint'),
    [
        (lambda watch: watch.end('gone'), '', Level.ERROR, 'simulator failed: gone', 'cable'),
        (lambda watch: watch.stop(), '', Level.WARN, 'the driver is inactive', 'activate it'),
        (lambda _: None, 'port is gone', Level.ERROR, 'port is gone', 'reset the stop'),
    ],
)
def test_a_source_that_is_not_well_says_so(running, change, trouble, level, text, hint):
    watch, now = running
    change(watch)
    source = findings(watch, now + 60.0, trouble, samples_lost=7)[0]
    assert (source.level, source.text, source.values['samples_lost']) == (level, text, 7)
    assert hint in source.hint
