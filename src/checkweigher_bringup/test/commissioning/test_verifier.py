# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verification on a simulated line, by the action of the node and at the terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import hashlib
import json
import math
from pathlib import Path
import queue
import resource
import signal
import time

from calibration_dialogue import Dialogue
from checkweigher_msgs.action import RunVerification
from checkweigher_msgs.srv import AnswerVerification, BeginVerification
from graph import Goal, call, make_stages, wait_for
from here import run_here
from made_procedure import CELL, GUIDED_LINE, SHORT_PLAN, START
import numpy as np
from processes import parameter_file
import pytest
from rclpy.parameter import Parameter
from running import PATIENCE
from std_srvs.srv import Trigger
import yaml

from checkweigher_bringup.commissioning.verification_guide import VerificationNode
from checkweigher_bringup.commissioning.verifier import VerifierNode
from checkweigher_bringup.spinning import Process, node_command, running_processes, spinning
from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    ProgressState,
    SampleBlock,
    StepAnswer,
    Verdict,
    VerificationProgress,
)
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_driver.driver_node import DriverNode
from checkweigher_production.audit_log import AuditLog

LANE = 'guided'
MAKE, SKIP, GO_ON = StepAnswer


class Operator(PortNode):
    """Operator in another process of the graph."""

    def __init__(self) -> None:
        super().__init__('operator')
        self._heard: queue.SimpleQueue[VerificationProgress] = queue.SimpleQueue()
        self.said = VerificationProgress(0, ProgressState.IDLE)
        self.subscribe(ports.VERIFICATION_PROGRESS, self._heard.put)

    def wait(self, condition: Callable[[VerificationProgress], object]) -> None:
        while not condition(self.said):
            self.said = self._heard.get(timeout=PATIENCE)

    def begin(self, plan: str = SHORT_PLAN) -> Goal:
        """Begin a verification, and return it when it has begun or was refused."""
        goal = Goal(self, RunVerification, ports.RUN_VERIFICATION, plan=plan)
        wait_for(lambda: goal.done or goal.feedback)
        return goal

    def answer(self, answer: StepAnswer, reason: str = '', question: int | None = None) -> str:
        """Answer the latest or another question, and return why the answer was refused."""
        asked = self.said.question if question is None else question
        values = {'question': asked, 'answer': int(answer), 'reason': reason}
        found = call(self, AnswerVerification, ports.ANSWER_VERIFICATION, **values)
        return '' if found.success else str(found.message)

    def break_off(self) -> str:
        return str(call(self, Trigger, ports.CANCEL_VERIFICATION).message)

    def asked_for(self, step: str) -> None:
        self.wait(lambda said: said.state is ProgressState.ASKING and said.steps[said.step] == step)


@contextmanager
def guided(folder: Path) -> Iterator[tuple[Process, Operator]]:
    """Run a line, the node `verifier` in its own process, and an operator."""
    folder.mkdir()
    file = parameter_file(folder / 'node.yaml', {'verifier': {'folder': str(folder)}})
    command = node_command('checkweigher_bringup.commissioning.verifier', LANE, file)
    with spinning(LANE) as spinner, running_processes({'verifier': command}) as started:
        spinner.add(*make_stages())
        operator = Operator()
        spinner.add(DriverNode(GUIDED_LINE))
        spinner.add(operator)
        operator.wait(lambda said: said.folder)
        yield started['verifier'], operator


def check_same(folder: Path, scratch: Path) -> dict[str, object]:
    """Check that the bag of a report gives the same report, and return the report."""
    done = run_here('verify', '--from', folder / 'bag', '--output', scratch)
    assert done.returncode == 1, done.stderr
    for name in ('report.html', 'report.json'):
        assert (scratch / name).read_bytes() == (folder / name).read_bytes()
    return dict(json.loads((folder / 'report.json').read_text()))


def test_a_procedure_that_is_broken_off_has_a_report_of_what_was_made(tmp_path: Path):
    with guided(tmp_path / 'machine') as (verifier, operator):
        assert operator.break_off() == 'nothing to cancel'
        assert 'the plan: ' in operator.begin('class: none').message
        assert 'no verification is running' in operator.answer(MAKE)
        begun = operator.begin()
        assert 'busy' in operator.begin().message
        operator.asked_for('warm_up_zero_0')
        assert 'is no longer open' in operator.answer(MAKE, question=operator.said.question + 1)
        assert 'repeat the failed step, or' in operator.answer(GO_ON)
        assert 'say why' in operator.answer(SKIP)
        assert not operator.answer(MAKE)
        assert 'is no longer open' in operator.answer(MAKE)
        operator.asked_for('warm_up_0')
        assert operator.said.results[0].startswith('passed')
        assert not operator.answer(SKIP, 'no product')
        operator.asked_for('warm_up_zero_0.02')
        assert operator.said.results[1] == 'skipped: no product'
        assert begun.cancel()
        assert begun.message == 'incomplete'
        made = tmp_path / 'machine' / 'verifications' / operator.said.name
        assert begun.result.folder == str(made)
        assert begun.feedback[-1].progress.text == f'{made.name}: incomplete'

        # Another one, begun by the service before the action, ends with its node.
        by_service = {'plan': SHORT_PLAN}
        assert call(operator, BeginVerification, ports.BEGIN_VERIFICATION, **by_service).success
        operator.asked_for('warm_up_zero_0')
        assert not operator.answer(SKIP, 'no time')
        operator.asked_for('warm_up_0')
        verifier.send_signal(signal.SIGTERM)
        assert verifier.wait(PATIENCE) == 0
        ended = tmp_path / 'machine' / 'verifications' / operator.said.name
    report = check_same(made, tmp_path / 'again')
    steps = report['steps']
    assert isinstance(steps, list)
    assert [(step['name'], step['verdict']) for step in steps] == [
        ('warm_up_zero_0', 'passed'), ('warm_up_0', 'skipped')
    ]  # fmt: skip
    departures = check_same(ended, tmp_path / 'again_ended')['departures']
    assert isinstance(departures, list)
    assert 'Parameters and audit log were not read again after the last step.' in departures


def test_the_command_and_the_page_answer_the_same_questions(tmp_path: Path):
    plan = tmp_path / 'plan.yaml'
    plan.write_text(SHORT_PLAN)
    with guided(tmp_path / 'machine') as (_, operator):
        dialogue = Dialogue(plan, '--namespace', LANE, command='verify')
        try:
            assert '1/9 warm_up_zero_0' in dialogue.asked()
            operator.asked_for('warm_up_zero_0')
            dialogue.answer()
            assert '2/9 warm_up_0' in dialogue.asked()
            operator.asked_for('warm_up_0')
            assert not operator.answer(SKIP, 'no product')  # as another person at the page
            dialogue.answer()
            assert '3/9 warm_up_zero_0.02' in dialogue.asked()
            made = Path(operator.said.folder) / 'verifications' / operator.said.name
            dialogue.process.send_signal(signal.SIGINT)
            status, printed, errors = dialogue.end()
        finally:
            dialogue.process.kill()
        assert status == 130, errors
        assert 'warm_up_zero_0, passed' in printed
        assert 'this question is no longer open' in printed
        assert 'warm_up_0, skipped: no product' in printed
    steps = check_same(made, tmp_path / 'again')['steps']
    assert isinstance(steps, list)
    assert [step['verdict'] for step in steps] == ['passed', 'skipped']


def test_a_bag_that_cannot_be_written_ends_the_procedure_after_the_step(tmp_path: Path):
    with guided(tmp_path / 'machine') as (verifier, operator):
        begun = operator.begin()
        operator.asked_for('warm_up_zero_0')
        _, hard = resource.prlimit(verifier.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(verifier.pid, resource.RLIMIT_FSIZE, (0, hard))  # as on a full disk
        time.sleep(3.0)  # the node writes its messages once a second
        assert not operator.answer(MAKE)
        wait_for(lambda: begun.done)
        assert 'File too large' in begun.message


def test_a_verification_without_a_line_says_so(tmp_path: Path):
    with spinning(LANE) as spinner:
        operator = Operator()
        spinner.add(operator, VerifierNode({'folder': str(tmp_path)}))
        operator.wait(lambda said: said.folder)
        begun = operator.begin()
        assert not begun.success
        assert begun.message.startswith('no samples within')
        assert not any((tmp_path / 'verifications').iterdir())
        assert not operator.begin().done  # the node lives on


def test_a_folder_has_to_be_given():
    with spinning(LANE), pytest.raises(ParameterError, match=r'verifier\.folder'):
        VerifierNode()


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
                if 'warm_up_0.02' in question:  # amid the steps the line is made another one
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
                    dialogue.answer('no weights' if 'warm_up_0.02' in question else '')
                else:  # passes of small that were none are made once more
                    assert 'Type r to repeat the step' in question
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
        ('warm_up_0.02', 'skipped'), ('zero_1', 'passed'), ('zero_2', 'passed'),
        ('passes_60_middle', 'passed'), ('passes_60_small', 'failed'),
        ('passes_60_small', 'failed'), ('zero_after', 'passed'),
    ]  # fmt: skip
    assert report['verdict'] == 'failed'
    steps = {step['name']: step for step in report['steps']}
    assert set(report['departures']) <= set(printed.splitlines())
    for name in ('zero_1', 'zero_2', 'zero_after'):  # the operator has seen the mass of the report
        assert f'{name}, passed, reading {steps[name]["reading"]["mass_g"]:+.4f} g' in printed
    assert steps['warm_up_0.02']['why'] == ['no weights']
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
        'Parameter reject.max_speed was inf before the first step and 2.5 after the last step.',
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
