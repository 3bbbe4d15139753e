# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learned parameters of a line: kept over a restart, discarded by a service, in the audit log."""

from pathlib import Path
from typing import Any

from graph import aspect, wait_for
from lines import simulated
from product_line import Line
import pytest
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from checkweigher_core.health.findings import Finding, Level
from checkweigher_core.ros import ports
from checkweigher_core.ros.outputs import Output
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_validation.accuracy.passes import known_passes

LEARN = {'learn': True, 'estimator': 'mean', 'learning.fewest': 20}


def finding(node: Any) -> Finding:
    return aspect(node, 'Learning')


def test_what_was_learned_outlives_a_restart_and_not_the_service(
    line: Line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Output, 'send', lambda *_: None)  # no items of this line
    recording = simulated(profile='machine:206', speed=1.0, count=25, masses=(0.1645,))
    passes = known_passes(recording.load_cell, recording, SegmenterParameters())
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path))
    identifier = line.stages['identifier']
    assert finding(identifier).text == 'off'
    identifier.set_parameters([Parameter(name, value=value) for name, value in LEARN.items()])

    windows = next(each for each in identifier.inputs if each.port is ports.DENOISED_WINDOW)
    for each in passes:
        windows.take(each.window)

    assert '1 of 1 speeds and lengths are weighed' in finding(identifier).text
    (record,) = tmp_path.glob('checkweigher/*.learned')
    wait_for(lambda: len(line.entries('learned')) == 1)
    assert 'weighs; standard deviation' in line.entries('learned')[0].new['learned']

    line.restart('identifier')
    identifier = line.stages['identifier']
    identifier.set_parameters([Parameter(name, value=value) for name, value in LEARN.items()])
    assert '1 of 1 speeds and lengths are weighed' in finding(identifier).text

    answer = line.call(Trigger, 'forget_learned')
    assert (answer.success, answer.message) == (True, '1 speeds and lengths forgotten')
    assert line.entries('learned')[-1].new == 'forgotten'
    assert '"kinds": []' in record.read_text()
    assert finding(identifier).text.startswith('0 items at one')


def test_a_record_that_cannot_be_used_is_told_and_the_line_weighs(line: Line, tmp_path: Path):
    record = tmp_path / 'record'
    record.write_text('{"version": 1')
    changes = {'learning.record': str(record), **LEARN}
    identifier = line.stages['identifier']
    identifier.set_parameters([Parameter(name, value=value) for name, value in changes.items()])
    assert finding(identifier).level == Level.WARN
    assert str(record) in finding(identifier).message
