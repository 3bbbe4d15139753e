# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibration of a load cell on a serial port by action and services of a running driver."""

from pathlib import Path
import queue
from typing import Any

from calibration_dialogue import Dialogue
from checkweigher_msgs.action import ReadLoad
from checkweigher_msgs.srv import CalibrateSpan, FinishCalibration
from full_disk import file_size_limit
from graph import Goal, call, wait_for
import pytest
from rclpy.node import Node
from running import PATIENCE
from serial_line import SerialDevice
from std_srvs.srv import Trigger
import yaml

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.parameters import ParameterError
from checkweigher_core.ros import ports
from checkweigher_driver.driver_node import DriverNode
from checkweigher_production.audit_log import read_log
from checkweigher_production.nodes.product import ProductNode

LANE = 'calibrating'

TAKEN_FOR, SENSITIVITY, ZERO = 500_000.0, 480_000, 1_250_000  # of the device, which is the truth
NOISE = 40  # counts, more than that of the device


class Technician:
    """Client of the action and the services, which also receives the load cell."""

    def __init__(self, spinner: Spinner) -> None:
        self._node = Node('technician')
        self.infos: queue.SimpleQueue[Any] = queue.SimpleQueue()
        topic = ports.LOAD_CELL_INFO
        self._node.create_subscription(topic.type, topic.name, self.infos.put, topic.qos)
        self._latest = 0
        topic = ports.LOAD_CELL_SAMPLES
        self._node.create_subscription(topic.type, topic.name, self._samples, topic.stage_qos)
        spinner.add(self._node)

    def _samples(self, block: Any) -> None:
        self._latest = block.counts[0]

    def put_on(self, device: SerialDevice, level: int) -> None:
        """Put a load on the belt, and wait until the port has delivered all older samples."""
        device.tell(f'level {level}')
        wait_for(lambda: abs(self._latest - ZERO - level) < NOISE)

    def call(self, kind: type, name: str, **values: float) -> Any:
        return call(self._node, kind, name, **values)

    def read(self, mass: float) -> Goal:
        return Goal(self._node, ReadLoad, ports.READ_LOAD, mass=mass)

    def finish(self, **values: float) -> Any:
        return self.call(FinishCalibration, ports.FINISH_CALIBRATION, **values)


def test_a_line_is_calibrated_and_weighs_by_it_from_then_on(spinner: Spinner, tmp_path: Path):
    port, path, log = tmp_path / 'port', tmp_path / 'cell.yaml', tmp_path / 'audit.log'
    device = SerialDevice(port, '--signal', 'slow')
    parameters = {
        'source': 'aed', 'aed.port': str(port), 'aed.counts_per_kg': TAKEN_FOR,
        'aed.capacity': 7.2, 'aed.weigh_length': 0.2, 'calibration.file': str(path),
        'calibration.duration': 0.5, 'calibration.patience': 5.0,
    }  # fmt: skip
    try:
        for make in STAGE_NODES.values():
            spinner.add(make())
        spinner.add(ProductNode({'audit_log': str(log)}))
        spinner.add(DriverNode(parameters))
        technician = Technician(spinner)
        assert technician.infos.get(timeout=PATIENCE).counts_per_kg == TAKEN_FOR

        assert 'no load was read' in technician.finish().message
        for mass in (0.0, 0.2, 1.0, 0.0):
            technician.put_on(device, round(mass * SENSITIVITY))
            done = technician.read(mass)
            assert done.success, done.message
            latest = done.feedback[-1]
            assert latest.load == pytest.approx(mass * SENSITIVITY / TAKEN_FOR, rel=0.05, abs=20)
            assert abs(latest.drift) < latest.tolerance
        # The noise of the device is within 30 counts, so no mass is off by more than 0.1 g.
        refused = technician.finish(max_residual=1e-9)
        assert not refused.success
        assert 'the largest residual is' in refused.message
        with file_size_limit(log.stat().st_size + 10):
            refused = technician.finish(max_residual=1e-4)
        assert not refused.success
        assert 'not in the audit log' in refused.message
        assert not path.exists()
        done = technician.finish(max_residual=1e-4)

        assert done.success, done.message
        assert (done.file, done.version) == (str(path), 1)
        assert done.counts_per_kg == pytest.approx(SENSITIVITY, rel=2e-5)
        assert done.zero_counts == pytest.approx(ZERO, abs=10)
        assert list(done.masses) == [0.0, 0.2, 1.0, 0.0]
        info = technician.infos.get(timeout=PATIENCE)
        assert (info.counts_per_kg, info.zero_counts) == (done.counts_per_kg, done.zero_counts)
        assert yaml.safe_load(path.read_text())['/**/driver']['ros__parameters']['aed'] == {
            'counts_per_kg': done.counts_per_kg, 'zero_counts': done.zero_counts
        }  # fmt: skip

        def noted() -> list[Any]:
            return [entry for entry in read_log(log).entries if entry.kind == 'calibration']

        wait_for(lambda: len(noted()) == 2)
        change = noted()[1]
        assert change.old['counts_per_kg'] == TAKEN_FOR
        assert change.new['counts_per_kg'] == done.counts_per_kg

        # The new stream is read; the empty belt alone leaves the sensitivity as it is.
        technician.put_on(device, 5000)
        # The services before the action do the same.
        assert technician.call(Trigger, ports.CALIBRATE_ZERO).success
        again = technician.finish()
        assert again.success, again.message
        assert again.version == 2
        assert again.counts_per_kg == done.counts_per_kg
        assert again.zero_counts == pytest.approx(ZERO + 5000, abs=10)
    finally:
        device.end()


def test_the_command_lets_the_driver_write_its_file(spinner: Spinner, tmp_path: Path):
    port, path = tmp_path / 'port', tmp_path / 'cell.yaml'
    device = SerialDevice(port, '--signal', 'slow')
    try:
        spinner.add(
            DriverNode({
                'source': 'aed', 'aed.port': str(port), 'aed.counts_per_kg': TAKEN_FOR,
                'aed.capacity': 7.2, 'aed.weigh_length': 0.2, 'calibration.file': str(path),
                'calibration.duration': 0.5, 'calibration.patience': 5.0,
            })
        )  # fmt: skip
        technician = Technician(spinner)
        # A reading of another calibration, which was not finished, is no part of this one.
        technician.put_on(device, round(0.5 * SENSITIVITY))
        assert technician.read(0.7).success
        dialogue = Dialogue('--masses', 200, 1000, '--namespace', LANE)
        for mass, request in (
            (0.0, 'Empty'),
            (0.2, 'Put 200 g'),
            (1.0, 'Put 1000'),
            (0.0, 'Empty'),
        ):
            assert request in dialogue.asked()
            technician.put_on(device, round(mass * SENSITIVITY))
            dialogue.answer()
        status, printed, errors = dialogue.end()
        assert status == 0, errors
        assert f'version 1 of {path}' in printed
        found = yaml.safe_load(path.read_text())['/**/driver']['ros__parameters']['aed']
        assert found['counts_per_kg'] == pytest.approx(SENSITIVITY, rel=2e-5)

        # Nothing is written if the technician gives up, and no reading is kept.
        dialogue = Dialogue('--zero', '--namespace', LANE)
        dialogue.asked()
        dialogue.process.stdin.close()
        assert dialogue.process.wait(PATIENCE) == 2
        assert 'no load was read' in technician.finish().message
    finally:
        device.end()


def test_what_cannot_be_read_is_refused_with_what_to_do(spinner: Spinner, tmp_path: Path):
    path = tmp_path / 'cell.yaml'
    line = {'lossless': False, 'simulator.count': 0, 'simulator.lead_in': 0.5}
    reading = {'calibration.file': str(path), 'calibration.duration': 3.0}
    driver = DriverNode({**line, **reading})
    spinner.add(driver)
    technician = Technician(spinner)
    technician.infos.get(timeout=PATIENCE)
    passing = technician.read(0.0)
    assert not passing.success
    # A product is on its way, or there already.
    assert 'eye' in passing.message
    assert 'empty the belt' in passing.message or 'stop the feed' in passing.message
    assert 'above 0' in technician.read(-1.0).message
    refused = technician.call(CalibrateSpan, ports.CALIBRATE_SPAN, mass=-1.0)
    assert 'above 0' in refused.message
    spinner.remove(driver)

    driver = DriverNode({**line, 'lossless': True})
    spinner.add(driver)
    assert 'calibration.file of the driver is empty' in technician.read(0.0).message
    spinner.remove(driver)

    driver = DriverNode({**reading, 'autostart': False})
    spinner.add(driver)
    assert 'not active' in technician.read(0.0).message
    assert not path.exists()


def test_a_reading_that_is_cancelled_leaves_no_point(spinner: Spinner, tmp_path: Path):
    line = {'lossless': False, 'simulator.count': 0, 'simulator.now.feed': False}
    reading = {'calibration.file': str(tmp_path / 'cell.yaml'), 'calibration.duration': 20.0}
    spinner.add(DriverNode({**line, **reading}))
    technician = Technician(spinner)
    technician.infos.get(timeout=PATIENCE)
    begun = technician.read(0.0)
    wait_for(lambda: begun.feedback)
    assert technician.read(0.0).message.startswith('a load is being read already')
    assert begun.cancel()
    assert 'no load was read' in technician.finish().message


def test_a_file_that_is_no_calibration_of_the_source_does_not_start_it(
    spinner: Spinner, tmp_path: Path
):
    path = tmp_path / 'cell.yaml'
    path.write_text('/**/driver:\n  ros__parameters:\n    source: simulator\n')
    with pytest.raises(ParameterError, match='is not a calibration file'):
        DriverNode({'calibration.file': str(path)})
