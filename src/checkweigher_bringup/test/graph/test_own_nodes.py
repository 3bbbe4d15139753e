# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Programs of docs/own_driver.md, own_stage.md and own_plc.md, run as they are printed."""

from collections.abc import Callable, Iterator
from pathlib import Path
import signal
import subprocess
import sys
import time

from checkweigher_msgs.msg import Verdict
from graph import heard
from modbus_machine import REJECTOR, RELEASE, Plc
import pytest
from rclpy.node import Node
from running import PATIENCE, printed, wait_for

from checkweigher_bringup.spinning import Spinner
from checkweigher_core.ros import ports

LANE = 'own_nodes'
NAMESPACE = f'/{LANE}'
Process = subprocess.Popen[bytes]
Start = Callable[..., Process]


@pytest.fixture
def start() -> Iterator[Start]:
    """Start Python with arguments, in the namespace of these tests."""
    started: list[Process] = []

    def begin(*arguments: str) -> Process:
        names = ['--ros-args', '-r', f'__ns:={NAMESPACE}']
        started.append(subprocess.Popen([sys.executable, *arguments, *names]))
        return started[-1]

    yield begin
    # rclpy wakes its executor before it shuts the context down. A node without timers may sleep on
    # after a signal, and ends by the next one, which `ros2 launch` sends as well.
    end = time.monotonic() + PATIENCE
    while alive := [process for process in started if process.poll() is None]:
        assert time.monotonic() < end
        for process in alive:
            process.terminate()
        time.sleep(1)


def start_stages(start: Start, *arguments: str) -> list[Process]:
    """Start the stages with a distant rejector, so that a busy computer is also in time."""
    far = ['--ros-args', '-p', 'rejector_distance:=8.0', '--ros-args', *arguments]
    names = 'segmenter', 'denoise', 'identifier', 'reject'
    return [start('-m', f'checkweigher_dsp.nodes.{name}', *far) for name in names]


def test_the_printed_nodes_weigh_from_the_first_product_on(
    tmp_path: Path, spinner: Spinner, start: Start
):
    node = Node('listener')
    verdicts = heard(node, ports.VERDICT, latched=True)
    spinner.add(node)
    # The driver first, because the order must not matter.
    start(printed('own_driver', tmp_path))
    start(printed('own_stage', tmp_path))
    # As line.launch.py hands it to each node.
    start_stages(start, '--remap', 'identifier:denoised_window:=corrected_window')
    found: list[Verdict] = [verdicts.get(timeout=PATIENCE)[1] for _ in range(3)]
    assert [verdict.item_id for verdict in found] == [1, 2, 3]
    assert [verdict.decision for verdict in found] == 3 * [Verdict.ACCEPT]
    # The driver has products of 0.2 kg, to which the stage adds 0.1 %.
    assert [verdict.mass for verdict in found] == pytest.approx(3 * [0.2002], abs=1e-5)


def test_the_printed_bridge_runs_the_belt_while_it_may_run(tmp_path: Path, start: Start):
    plc = Plc(tmp_path)
    plc.start('--watchdog', '2')
    bridge = start(printed('own_plc', tmp_path), '--ros-args', '-p', f'port:={plc.port}')
    try:
        wait_for(lambda: plc.state(REJECTOR) is True)
        assert plc.state(RELEASE) is False, 'there is no line yet'
        start(printed('own_driver', tmp_path))
        *_, reject = start_stages(start)
        wait_for(lambda: plc.state(RELEASE) is True)
        wait_for(lambda: plc.state(REJECTOR) is False)  # an accepted product passes
        wait_for(lambda: plc.state(REJECTOR) is True)  # the gap behind it
        reject.kill()
        wait_for(lambda: plc.state(RELEASE) is False)
        start('-m', 'checkweigher_dsp.nodes.reject')
        wait_for(lambda: plc.state(RELEASE) is True)
        bridge.send_signal(signal.SIGSTOP)
        wait_for(lambda: plc.state(RELEASE) is False)
    finally:
        bridge.kill()
        plc.kill()
