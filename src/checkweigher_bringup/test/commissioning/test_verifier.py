# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node verifier beside a simulated line that runs, by its services."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import json
from pathlib import Path
import queue
import signal

from checkweigher_msgs.srv import AnswerVerification, BeginVerification
from graph import call, make_stages, wait_for
from here import run_here
from made_procedure import GUIDED_LINE, SHORT_PLAN
from processes import parameter_file
import pytest
from running import PATIENCE
from std_srvs.srv import Trigger

from checkweigher_bringup.commissioning.verifier import VerifierNode
from checkweigher_bringup.spinning import Process, node_command, running_processes, spinning
from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import ProgressState, StepAnswer, VerificationProgress
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_driver.driver_node import DriverNode

LANE = 'guided'
MAKE, SKIP, GO_ON = StepAnswer


class Operator(PortNode):
    """Somebody elsewhere on the graph."""

    def __init__(self) -> None:
        super().__init__('operator')
        self._heard: queue.SimpleQueue[VerificationProgress] = queue.SimpleQueue()
        self.said = VerificationProgress(0, ProgressState.IDLE)
        self.subscribe(ports.VERIFICATION_PROGRESS, self._heard.put)

    def wait(self, condition: Callable[[VerificationProgress], object]) -> None:
        while not condition(self.said):
            self.said = self._heard.get(timeout=PATIENCE)

    def begin(self, plan: str = SHORT_PLAN) -> str:
        answer = call(self, BeginVerification, ports.BEGIN_VERIFICATION, plan=plan)
        return '' if answer.success else str(answer.message)

    def answer(self, answer: StepAnswer, reason: str = '', question: int | None = None) -> str:
        """Answer the question that was heard last, or another; return why it was refused."""
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
    """Run a line, the node in a process of its own as `run --folder` does, and somebody."""
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
    """Hold a report to the one that its bag gives, and return it."""
    done = run_here('verify', '--from', folder / 'bag', '--output', scratch)
    assert done.returncode == 1, done.stderr
    for name in ('report.html', 'report.json'):
        assert (scratch / name).read_bytes() == (folder / name).read_bytes()
    return dict(json.loads((folder / 'report.json').read_text()))


def test_a_procedure_that_is_broken_off_has_a_report_of_what_was_made(tmp_path: Path):
    with guided(tmp_path / 'machine') as (verifier, operator):
        assert operator.break_off() == 'nothing is under way'
        assert 'the plan: ' in operator.begin('class: none')
        assert 'no verification goes on' in operator.answer(MAKE)
        assert not operator.begin()
        assert 'busy' in operator.begin()
        operator.asked_for('warm_up_zero_0')
        assert 'is not asked any more' in operator.answer(MAKE, question=operator.said.question + 1)
        assert 'made again, or left' in operator.answer(GO_ON)
        assert 'say why' in operator.answer(SKIP)
        assert not operator.answer(MAKE)
        assert 'is not asked any more' in operator.answer(MAKE)
        operator.asked_for('warm_up_0')
        assert operator.said.results[0].startswith('passed')
        assert not operator.answer(SKIP, 'no product')
        operator.asked_for('warm_up_zero_0.02')
        assert operator.said.results[1] == 'skipped: no product'
        assert 'it ends' in operator.break_off()
        operator.wait(lambda said: said.state is ProgressState.IDLE)
        assert operator.said.text.endswith(': incomplete')
        made = tmp_path / 'machine' / 'verifications' / operator.said.name

        # Another one ends with its node.
        assert not operator.begin()
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


def test_a_verification_without_a_line_says_so(tmp_path: Path):
    with spinning(LANE) as spinner:
        operator = Operator()
        spinner.add(operator, VerifierNode({'folder': str(tmp_path)}))
        operator.wait(lambda said: said.folder)
        assert not operator.begin()
        operator.wait(lambda said: said.name)
        operator.wait(lambda said: said.state is ProgressState.IDLE)
        assert 'not made: no samples within' in operator.said.text
        wait_for(lambda: not any((tmp_path / 'verifications').iterdir()))
        assert not operator.begin()  # the node lives on


def test_a_folder_has_to_be_given():
    with spinning(LANE), pytest.raises(ParameterError, match=r'verifier\.folder'):
        VerifierNode()
