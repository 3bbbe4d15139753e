# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Static calibration at the terminal, on a running line and on an opened source."""

from collections.abc import Iterator
from pathlib import Path
import sys
import threading
import time

from calibration_dialogue import Dialogue
import numpy as np
import pytest
import rclpy
from running import run_command
import yaml

from checkweigher_bringup.cli import build_parser
from checkweigher_bringup.commands.line import calibrate as calibrate_command
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.settings import line_parameters
from checkweigher_core.records import LoadCell, SampleBlock
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_driver.calibration.file import check_calibration_file, write_version
from checkweigher_driver.calibration.static_calibration import (
    CalibrationError,
    CalibrationPoint,
    calibrate,
)

RATE, BLOCK = 960.0, 48
# What the scale is, and what it is taken for before it has been calibrated.
ZERO, SENSITIVITY = 123_456.0, 480_000.0
TAKEN_FOR = LoadCell(RATE, 500_000.0, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2)
POINTS = [CalibrationPoint(0.0, 1000.0, 3.0), CalibrationPoint(2.0, 5000.0, 4.0)]


class Scale:
    """Scale that publishes its load in real time."""

    def __init__(self) -> None:
        self.mass = 0.0
        self._ending = threading.Event()
        rclpy.init()
        self._node = rclpy.create_node('scale')
        self._publishers = [
            self._node.create_publisher(topic.type, topic.name, topic.qos)
            for topic in (ports.LOAD_CELL_INFO, ports.LOAD_CELL_SAMPLES)
        ]
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        info, samples = self._publishers
        info.publish(to_message(ports.LOAD_CELL_INFO, TAKEN_FOR, stamp=time.time_ns()))
        random, index, due = np.random.default_rng(1), 0, time.monotonic()
        while not self._ending.wait(max(due - time.monotonic(), 0.0)):
            due += BLOCK / RATE
            counts = ZERO + SENSITIVITY * self.mass + 40 * random.normal(size=BLOCK)
            block = SampleBlock(time.time_ns(), index, np.round(counts).astype(np.int32))
            samples.publish(to_message(ports.LOAD_CELL_SAMPLES, block))
            index += BLOCK

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown()


@pytest.fixture
def scale() -> Iterator[Scale]:
    made = Scale()
    yield made
    made.close()


def test_a_line_that_runs_is_calibrated_in_a_dialogue(scale: Scale, tmp_path: Path):
    output = tmp_path / 'scale.yaml'
    options = ('--source', 'simulator', '--output', output, '--duration', 0.5, '--tolerance', 0.1)
    dialogue = Dialogue('--masses', 200, 1000, '--mass-uncertainty', 0.001, *options)
    for mass, question in ((0.0, 'Empty'), (0.2, 'Put 200 g'), (1.0, 'Put 1000 g'), (0.0, 'Empty')):
        assert question in dialogue.asked()
        scale.mass = mass
        dialogue.answer()
    status, printed, errors = dialogue.end()
    assert status == 0, errors
    assert 'version 1 written' in printed

    found = yaml.safe_load(output.read_text())['/**/driver']['ros__parameters']['simulator']
    # The mean of 480 samples is good for 40 / sqrt(480) counts; a mass of 1 kg for 1e-6 of itself.
    assert found['counts_per_kg'] == pytest.approx(SENSITIVITY, rel=2e-5)
    assert found['zero_counts'] == pytest.approx(ZERO, abs=10)
    # The file is one that the commands and the nodes take.
    line_parameters(output, None)


@pytest.mark.soak
def test_a_source_is_opened_and_its_zero_read(tmp_path: Path):
    base = tmp_path / 'line.yaml'
    base.write_text(
        '/**/driver:\n  ros__parameters:\n    source: simulator\n    simulator.lead_in: 3600.0\n'
        '    simulator.zero_counts: 77000.0\n    simulator.profile: quiet\n'
    )
    output = tmp_path / 'calibrated.yaml'
    command = ('calibrate', '--zero', '--source', 'simulator', '--open', '--params', base)
    # Standard input is closed.
    done = run_command(*command, '--output', output, '--duration', 0.5)
    assert done.returncode == 2
    assert 'the input ended' in done.stderr.splitlines()[-1]
    assert not output.exists()

    dialogue = Dialogue(*command[1:], '--output', output, '--duration', 0.5)
    dialogue.asked()
    dialogue.answer()
    status, _, errors = dialogue.end()
    assert status == 0, errors
    driver = yaml.safe_load(output.read_text())['/**/driver']['ros__parameters']
    assert driver['source'] == 'simulator'
    assert driver['simulator']['zero_counts'] == pytest.approx(77_000, abs=5)


def test_old_versions_are_kept_as_they_were(tmp_path: Path):
    path = tmp_path / 'cell.yaml'
    texts = []
    for version in (1, 2, 3):
        points = [*POINTS, CalibrationPoint(1.0, 3000.0 + version, 2.0)]
        assert write_version(path, 'aed', calibrate(points), points) == version
        texts.append(path.read_text())
    assert [(tmp_path / f'cell.v{number}.yaml').read_text() for number in (1, 2)] == texts[:2]
    # The number of a newest version that was removed is not used again.
    path.unlink()
    assert write_version(path, 'aed', calibrate(POINTS), POINTS) == 3
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        'cell.v1.yaml', 'cell.v2.yaml', 'cell.yaml'
    ]  # fmt: skip


def test_what_is_no_calibration_is_not_overwritten(tmp_path: Path):
    path = tmp_path / 'line.yaml'
    path.write_text('/**/driver:\n  ros__parameters:\n    source: aed\n')
    with pytest.raises(CalibrationError, match='is not a calibration file'):
        check_calibration_file(path)
    with pytest.raises(CalibrationError, match='is a folder'):
        check_calibration_file(tmp_path)


def test_an_installed_package_is_no_place_for_a_calibration(tmp_path: Path):
    installed = Path(sys.modules['yaml'].__file__ or '').parent / 'cell.yaml'
    link = tmp_path / 'link'
    link.symlink_to(installed.parent)
    for path in (installed, link / 'cell.yaml'):
        with pytest.raises(CalibrationError, match='lies in the installed packages'):
            check_calibration_file(path)


def test_settings_of_a_line_are_not_those_of_a_command_without_a_file():
    arguments = build_parser().parse_args(['calibrate', '--zero', '--duration', '0'])
    with pytest.raises(UserError, match=r'--output: must name .* with --duration'):
        calibrate_command.run(arguments)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ((), r'--masses .*, --zero .* and --dynamic'),
        (('--zero',), '--source: must be the source to calibrate: simulator, aed, ascii'),
        (('--masses', 0, '--source', 'simulator'), '--masses 0'),
        (('--zero', '--source', 'bag'), 'its data contain the calibration'),
        (('--zero', '--source', 'nothing'), "'nothing' is not one of"),
        (('--zero', '--source', 'simulator', '--duration', 0), '--duration 0'),
        (('--zero', '--source', 'simulator', '--mass-uncertainty', -1), '--mass-uncertainty -1'),
    ],
)
def test_options_that_cannot_be_are_refused(
    options: tuple[object, ...], message: str, tmp_path: Path
):
    words = ['calibrate', *map(str, options), '--output', str(tmp_path / 'cell.yaml')]
    arguments = build_parser().parse_args(words)
    with pytest.raises(ValueError, match=message):  # of the command line, as one line
        calibrate_command.run(arguments)
    assert not list(tmp_path.iterdir())
