# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A verification on a simulated line that runs, with an operator at the keyboard."""

import hashlib
import json
import math
from pathlib import Path

from calibration_dialogue import Dialogue
from graph import make_stages, wait_for
from here import run_here
from made_procedure import CELL, GUIDED_LINE, SHORT_PLAN, START
import numpy as np
import pytest
from rclpy.parameter import Parameter
import yaml

from checkweigher_bringup.commissioning.verification_guide import VerificationNode
from checkweigher_bringup.spinning import spinning
from checkweigher_core.records import NANOSECONDS, Decision, SampleBlock, Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_driver.driver_node import DriverNode
from checkweigher_production.audit_log import AuditLog


def test_an_operator_is_guided_and_the_bag_gives_the_report_again(tmp_path: Path):
    plan, output = tmp_path / 'plan.yaml', tmp_path / 'out'
    plan.write_text(SHORT_PLAN)
    audit_log = tmp_path / 'audit.log'
    with AuditLog(audit_log) as log:
        log.append('2026-05-28T20:00:00', '/reject', 'parameter', 'max_speed', 3.0, 'inf')
    with spinning('verified') as spinner:
        nodes = [*make_stages(), DriverNode(GUIDED_LINE)]
        (reject,) = (node for node in nodes if node.get_name() == 'reject')
        spinner.add(*nodes)
        dialogue = Dialogue(
            plan, '--output', output, '--namespace', 'verified', '--audit', audit_log,
            command='verify',
        )  # fmt: skip
        wider = Parameter('max_speed', value=2.5)
        try:
            question, again = '', iter(('r', ''))
            while 'zero_after' not in question:
                question = dialogue.asked().splitlines()[-1]
                if 'zero_2' in question:  # amid the steps the line is made another one
                    spinner.call(lambda: reject.set_parameters([wider]))
                    with AuditLog(audit_log) as log:
                        for minute, old, new in ((0, 0.5, 0.6), (1, 0.6, 0.5)):  # and back again
                            log.append(
                                f'2026-05-28T20:0{minute}:30', '/segmenter', 'parameter',
                                'sample_lateness', old, new, who='ben',
                            )  # fmt: skip
                        last = log.append(
                            '2026-05-28T21:00:00', '/reject', 'parameter', 'max_speed', 'inf', 2.5
                        )
                if '/9 ' in question:
                    dialogue.answer('no weights' if 'zero_2' in question else '')
                else:  # passes of small that were none are made once more
                    assert 'Type r to make it again' in question
                    dialogue.answer(next(again))
            status, printed, errors = dialogue.end()
        finally:
            dialogue.process.kill()
            for node in reversed(nodes):
                spinner.remove(node)
    assert status == 1, errors
    assert 'passes_60_small, FAILED' in printed
    report = json.loads((output / 'report.json').read_text())
    made = [(step['name'], step['verdict']) for step in report['steps']]
    assert made == [
        ('warm_up_zero_0', 'passed'), ('warm_up_0', 'passed'), ('warm_up_zero_0.02', 'passed'),
        ('warm_up_0.02', 'passed'), ('zero_1', 'passed'), ('zero_2', 'skipped'),
        ('passes_60_middle', 'passed'), ('passes_60_small', 'failed'),
        ('passes_60_small', 'failed'), ('zero_after', 'passed'),
    ]  # fmt: skip
    assert report['verdict'] == 'failed'
    steps = {step['name']: step for step in report['steps']}
    assert steps['zero_2']['why'] == ['no weights']
    assert steps['passes_60_middle']['count'] == 2
    assert steps['passes_60_small']['error_g'] == pytest.approx(120, abs=0.5)
    assert steps['passes_60_middle']['passes'][0]['speed_m_per_min'] == pytest.approx(60, rel=0.01)
    assert report['identity']['how'] == 'on a running line'
    assert report['identity']['audit_log_last_hash'] == last.hash
    kept = hashlib.sha256(audit_log.read_bytes()).hexdigest()
    assert report['identity']['audit_log_sha256'] == kept
    changed = [each for each in report['departures'] if each.startswith(('Parameter ', 'Audit'))]
    lateness = 'parameter sample_lateness of /segmenter'
    assert changed == [
        'Parameter reject.max_speed was inf before the first step and 2.5 after the last one.',
        f'Audit log, 2026-05-28T20:00:30: {lateness} from 0.5 to 0.6, by ben.',
        f'Audit log, 2026-05-28T20:01:30: {lateness} from 0.6 to 0.5, by ben.',
        "Audit log, 2026-05-28T21:00:00: parameter max_speed of /reject from 'inf' to 2.5, by "
        'graph:/reject.',
    ]
    known = yaml.safe_load((output / 'parameters.yaml').read_text())
    assert known['/**/driver']['ros__parameters']['simulator.spacing'] == 3.0
    assert known['/**/segmenter']['ros__parameters']
    assert known['/**/reject']['ros__parameters']['max_speed'] == math.inf

    remade = tmp_path / 'again'
    assert run_here('verify', '--from', output / 'bag', '--output', remade).returncode == 1
    for name in ('report.html', 'report.json'):
        assert (remade / name).read_bytes() == (output / name).read_bytes()


def test_a_step_begins_after_the_verdicts_that_came_before_their_samples():
    with spinning() as spinner:
        node, line = VerificationNode(), PortNode('line')
        cell, samples, verdicts = map(
            line.output, (ports.LOAD_CELL_INFO, ports.LOAD_CELL_SAMPLES, ports.VERDICT)
        )
        spinner.add(line)
        spinner.add(node)
        cell.send(CELL)
        wait_for(lambda: samples.publisher.get_subscription_count() >= 2)  # recorded and read
        wait_for(lambda: verdicts.publisher.get_subscription_count() >= 2)
        verdicts.send(Verdict(1, START + NANOSECONDS, Decision.ACCEPT, t1=START))
        wait_for(lambda: not node.verdicts.empty())
        assert node.latest == START + NANOSECONDS
        node.feed.wait_for_load_cell()
        samples.send(SampleBlock(START, 0, np.zeros(96, np.int32)))
        next(node.feed.blocks())
        assert node.latest == START + NANOSECONDS
