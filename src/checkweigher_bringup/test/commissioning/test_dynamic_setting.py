# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dynamic setting of a simulated line: passes of a known mass at two speeds, then training."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import hashlib
import math
import os
from pathlib import Path
import re
from typing import Any

from calibration_dialogue import Dialogue
from checkweigher_msgs.action import RecordPasses, TunePasses
from checkweigher_msgs.msg import DynamicSetting
from checkweigher_msgs.srv import RecordPasses as RecordPassesService
from graph import Goal, call, heard, make_stages, wait_for
from lines import simulated, write_line
import numpy as np
from processes import children
import pytest
from rclpy.node import Node
from running import Rows
from std_srvs.srv import Trigger

from checkweigher_bringup.commissioning.dynamic_setting import DynamicSettingNode
from checkweigher_bringup.spinning import Spinner, spinning
from checkweigher_core.parameters import ParameterError
from checkweigher_core.ros import ports
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.audit_log import read_log
from checkweigher_production.nodes.product import ProductNode

MASS, PASSES = 0.1645, 12
LINE = {
    'simulator.profile': 'soft', 'simulator.masses': [MASS], 'simulator.count': 0,
    'simulator.seed': 3, 'rate': 6.0,
}  # fmt: skip


@contextmanager
def line(spinner: Spinner, speed: float) -> Iterator[None]:
    """Run a line on which products of one mass pass."""
    nodes = [*make_stages(), DriverNode({**LINE, 'simulator.speed': speed})]
    for node in nodes:
        spinner.add(node)
    try:
        yield
    finally:
        for node in reversed(nodes):
            spinner.remove(node)


class Technician:
    """Client of the actions of the dynamic setting, which also receives its states."""

    def __init__(self, spinner: Spinner) -> None:
        self._node = Node('technician')
        self._said = heard(self._node, ports.DYNAMIC_SETTING, latched=True)
        spinner.add(self._node)

    def call(self, kind: type, name: str, **values: object) -> Any:
        return call(self._node, kind, name, **values)

    def record(self, mass: float, passes: int) -> Goal:
        return Goal(self._node, RecordPasses, ports.RECORD_PASSES, mass=mass, passes=passes)

    def tune(self) -> Goal:
        return Goal(self._node, TunePasses, ports.TUNE_PASSES)

    def wait(self, condition: Callable[[DynamicSetting], bool]) -> list[DynamicSetting]:
        """Return the states up to the first one that meets a condition."""
        said: list[DynamicSetting] = []
        while not said or not condition(said[-1]):
            said.append(self._said.get(timeout=90)[1])
            assert said[-1].state != DynamicSetting.FAILED, said[-1].text
        return said


@pytest.mark.parametrize(
    ('estimator', 'speeds'),
    [('tvlpf', (1.5,)), pytest.param('iswd_eksi', (1.0, 1.5), marks=pytest.mark.soak)],
)
def test_passes_at_each_speed_make_parameters_that_weigh_better(
    rows: Rows, tmp_path: Path, estimator: str, speeds: tuple[float, ...]
):
    folder = tmp_path / 'setting'
    folder.mkdir()
    with spinning('setting') as spinner:
        parameters = {'folder': str(folder), 'budget': 8, 'estimator': estimator}
        spinner.add(DynamicSettingNode(parameters))
        technician = Technician(spinner)
        assert 'no passes' in technician.tune().message
        for speed in speeds:
            with line(spinner, speed):
                begun = technician.record(MASS, PASSES)
                wait_for(lambda begun=begun: begun.feedback)
                again = technician.record(MASS, PASSES)
                assert again.message.startswith('busy')
                assert begun.success, begun.message
                assert begun.feedback[-1].passes == PASSES
        told = technician.wait(lambda said: said.passes == PASSES and not said.state)
        assert [Path(bag).name for bag in told[-1].bags] == ['passes_1', 'passes_2'][: len(speeds)]
        assert begun.result.bag == told[-1].bags[-1]
        training = technician.tune()
        assert training.success, training.message
        # Feedback is the latest progress: a step that is over within one poll may be left out.
        said = {said.text for said in training.feedback}
        assert {'tuning'} <= said <= {'reading', 'preparing', 'tuning'}
        assert all(0 <= said.progress <= 1 for said in training.feedback)
        waiting = technician.wait(lambda said: said.text.startswith('tuned'))[-1]
        assert waiting.file == ''
        assert not (folder / 'machine.yaml').exists()
        heads, *accuracy = technician.call(Trigger, ports.SHOW_TUNED).message.splitlines()
        assert heads.split()[0] == 'estimator'
        assert [line.split()[0] for line in accuracy] == [estimator] * len(speeds)
        assert technician.call(Trigger, ports.ACCEPT_TUNED).success
        learned = technician.wait(lambda said: said.file != '')[-1]
        assert 'no learned parameters' in technician.call(Trigger, ports.ACCEPT_TUNED).message
    assert learned.file == str(folder / 'machine.yaml')

    for speed in speeds:  # other passes of other masses than those it was trained on
        recording = simulated(
            profile='soft', masses=(0.1, 0.2), count=12, speed=speed, seed=int(10 * speed)
        )
        bag = write_line(tmp_path / f'test_{speed}', recording)
        before, after = (
            rms(rows('weigh', bag, *how))
            for how in (('--estimator', estimator), ('--params', learned.file))
        )
        print(f'{speed} m/s: {before:.3f} g before, {after:.3f} g after')
        assert after < 0.8 * before


def rms(rows: list[dict[str, str]]) -> float:
    """Return the root mean square error in g."""
    errors = [float(row['mass_g']) - float(row['reference_g']) for row in rows]
    return math.sqrt(np.mean(np.square(errors)))


@pytest.mark.soak
def test_a_training_that_is_cancelled_ends_and_leaves_no_parameters(tmp_path: Path):
    for number, speed in ((1, 1.0), (2, 1.5)):  # two speeds, two workers
        line_of_speed = simulated(masses=(MASS,), count=4, speed=speed)
        write_line(tmp_path / f'passes_{number}', line_of_speed)
    with spinning('cancelled') as spinner:
        spinner.add(DynamicSettingNode({'folder': str(tmp_path), 'budget': 1_000_000}))
        technician = Technician(spinner)
        before = set(children(os.getpid()))
        begun = technician.tune()
        technician.wait(lambda said: said.state == DynamicSetting.TUNING)
        (training,) = set(children(os.getpid())) - before
        wait_for(lambda: len(children(training)) >= 2)  # the workers
        assert begun.cancel()
        assert begun.message == 'training cancelled'
    assert not (tmp_path / 'machine.yaml').exists()


def test_what_was_learned_waits_until_it_is_taken_over_or_dropped(tmp_path: Path):
    file, learned, log = (tmp_path / name for name in ('machine.yaml', 'machine.new.yaml', 'log'))
    file.write_text('# what the line has\n')
    with spinning('taken') as spinner:
        spinner.add(ProductNode({'audit_log': str(log)}))
        learned.write_text('# estimator A\n# hann 60.0 12 0.4 0.5\n')  # of a node before this one
        spinner.add(DynamicSettingNode({'folder': str(tmp_path)}))
        technician = Technician(spinner)
        technician.wait(lambda said: said.text.startswith('tuned'))
        dropped = technician.call(Trigger, ports.CANCEL_PASSES)
        assert dropped.message == f'the learned parameters were discarded; {file} is unchanged'
        assert not learned.exists()
        assert technician.call(Trigger, ports.CANCEL_PASSES).message == 'nothing to cancel'
        for name in (ports.SHOW_TUNED, ports.ACCEPT_TUNED):
            assert 'no learned parameters to accept' in technician.call(Trigger, name).message
        assert file.read_text() == '# what the line has\n'

        learned.write_text(text := '# estimator A\n# hann 60.0 12 0.2 0.3\nhann: 1\n')
        shown = technician.call(Trigger, ports.SHOW_TUNED)
        assert shown.message == 'estimator A\nhann 60.0 12 0.2 0.3'
        for mass, passes in ((-1.0, 3), (0.1, 0)):
            assert 'must be above 0' in technician.record(mass, passes).message
        begun = technician.record(0.1, 3)
        technician.wait(lambda said: said.state == DynamicSetting.RECORDING)
        assert technician.call(Trigger, ports.ACCEPT_TUNED).message.startswith('busy')
        assert begun.cancel()
        assert begun.message == '0 of 3 passes of 100 g recorded'
        assert begun.result.bag == ''
        # The services before the actions begin the same, and do not wait for its end.
        by_service = technician.call(RecordPassesService, ports.RECORD_PASSES, mass=0.1, passes=3)
        assert by_service.success, by_service.message
        technician.wait(lambda said: said.state == DynamicSetting.RECORDING)
        assert technician.call(Trigger, ports.TUNE_PASSES).message.startswith('busy')
        assert technician.call(Trigger, ports.CANCEL_PASSES).success
        technician.wait(lambda said: said.text.startswith('0 of 3') and not said.state)
        assert list(tmp_path.glob('passes_*')) == []
        taken = technician.call(Trigger, ports.ACCEPT_TUNED)
        assert taken.message == f'{file}, version 2; the line uses it from its next start'
    assert file.read_text() == text
    assert (tmp_path / 'machine.v1.yaml').read_text() == '# what the line has\n'
    (entry,) = (each for each in read_log(log).entries if each.kind == 'tuned')
    digest = hashlib.sha256(text.encode()).hexdigest()
    assert entry.subject == '/taken/dynamic_setting'
    assert entry.new == {'file': str(file), 'sha256': digest}


def test_without_an_entry_in_the_audit_log_nothing_is_taken_over(tmp_path: Path):
    learned = tmp_path / 'machine.new.yaml'
    learned.write_text('')
    with spinning('unwritten') as spinner:
        spinner.add(ProductNode({'audit_log': str(tmp_path / 'log')}))
        spinner.add(DynamicSettingNode({'folder': str(tmp_path)}))
        technician = Technician(spinner)
        (tmp_path / 'log').unlink()
        refused = technician.call(Trigger, ports.ACCEPT_TUNED)
    assert not refused.success
    assert 'not in the audit log' in refused.message
    assert learned.exists()
    assert not (tmp_path / 'machine.yaml').exists()


def test_a_folder_has_to_be_given():
    with spinning('without'), pytest.raises(ParameterError, match='is not an existing folder'):
        DynamicSettingNode()


@contextmanager
def passing_at_90(dialogue: Dialogue, spinner: Spinner) -> Iterator[None]:
    """Let products pass at 60 m/min, which was not asked for, and then at 90 m/min."""
    assert 'Set the belt to 90 m/min' in dialogue.asked()
    with line(spinner, 1.0):
        dialogue.answer()
        assert 'Set the belt to 90 m/min' in dialogue.asked()
    with line(spinner, 1.5):
        dialogue.answer()
        yield


@pytest.mark.soak
def test_the_command_guides_through_the_speeds(tmp_path: Path):
    output = tmp_path / 'machine.yaml'
    with spinning('guided') as spinner:
        dialogue = Dialogue(
            '--dynamic', '--reference', 1e3 * MASS, '--passes', 4, '--speeds', 90, '--output',
            output, '--namespace', 'guided', '--estimator', 'tvlpf', '--budget', 8,
        )  # fmt: skip
        with passing_at_90(dialogue, spinner):
            assert 'write these parameters to' in dialogue.asked()
            assert not output.exists()
            dialogue.answer('yes')
            status, printed, errors = dialogue.end()
    assert status == 0, errors
    assert 'the belt ran at 60' in printed
    assert 'version 1 written' in printed
    assert LineParameters.from_file(output).identifier.estimator == 'tvlpf'
    assert not output.with_name('machine.new.yaml').exists()


def test_the_command_lets_the_line_record_and_train(tmp_path: Path):
    file = tmp_path / 'machine.yaml'
    setting = {'folder': str(tmp_path), 'estimator': 'tvlpf', 'budget': 8}
    with spinning('guided') as spinner:
        spinner.add(DynamicSettingNode(setting))
        dialogue = Dialogue(
            '--dynamic', '--reference', 1e3 * MASS, '--passes', 6, '--speeds', 90,
            '--namespace', 'guided',
        )  # fmt: skip
        with passing_at_90(dialogue, spinner):
            assert 'accept these parameters' in dialogue.asked()
            assert not file.exists()
            dialogue.answer('yes')
            status, printed, errors = dialogue.end()
    assert status == 0, errors
    assert re.search(r'the belt ran at (59|60)[.]\d+ m/min, not at 90 m/min', printed)
    assert 'pass 6 of 6' in printed
    assert f'{file}, version 1' in printed
    assert LineParameters.from_file(file).identifier.estimator == 'tvlpf'
