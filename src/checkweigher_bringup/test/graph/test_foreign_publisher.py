# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A stranger beside the nodes of a line, and a user's node between two of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from checkweigher_msgs.msg import MassEstimate, StopRequest, Verdict
from graph import heard, wait_for
from processes import parameter_file
from rclpy.node import Node
from running import PATIENCE
from std_srvs.srv import Trigger
from supervised_line import supervised_line

from checkweigher_bringup.spinning import node_command, running_processes, spinning
from checkweigher_core.health.findings import Level
from checkweigher_core.ros import ports

SAYS = '/running/stranger publishes /running/mass_estimate'


def wait_until_heard(messages: Any, wanted: Callable[[Any], bool]) -> Any:
    """Return the next message that is wanted."""
    while not wanted(message := messages.get(timeout=PATIENCE)[1]):
        pass
    return message


def publishers_aspect(level: Level) -> Callable[[Any], bool]:
    name = 'running/reject: Publishers'
    return lambda array: any(s.name == name and s.level[0] == level for s in array.status)


def is_foreign(verdict: Verdict) -> bool:
    return verdict.decision == Verdict.FAULT and 'ForeignPublisher' in verdict.reasons


def test_a_stranger_stops_the_line_and_items_are_faults_until_it_has_gone(tmp_path: Path):
    with supervised_line(tmp_path) as line:
        stops = heard(line.listener, ports.STOP_REQUEST, latched=True)
        told = heard(line.listener, ports.DIAGNOSTICS)
        line.judge_until(Verdict.ACCEPT)
        stranger, port = Node('stranger'), ports.MASS_ESTIMATE
        line.spinner.add(stranger)
        publisher = stranger.create_publisher(port.type, port.name, port.qos)
        wait_for(lambda: publisher.get_subscription_count() > 0)
        publisher.publish(MassEstimate(item_id=10**6, mass=0.1))

        stop = wait_until_heard(stops, lambda each: each.state == StopRequest.STOP)
        assert stop.reason == StopRequest.FOREIGN_PUBLISHER
        assert stop.hint.endswith(f': {SAYS}')
        (error,) = (
            status
            for status in wait_until_heard(told, publishers_aspect(Level.ERROR)).status
            if status.name.endswith('Publishers')
        )
        assert SAYS in error.message
        wait_until_heard(line.verdicts, is_foreign)
        assert all(is_foreign(line.verdicts.get(timeout=PATIENCE)[1]) for _ in range(4))
        assert not line.call(Trigger, ports.RESET_STOP_REQUEST).success  # it is still there

        line.spinner.remove(stranger)
        wait_for(lambda: line.call(Trigger, ports.RESET_STOP_REQUEST).success)
        wait_until_heard(stops, lambda each: each.state == StopRequest.RUN)
        wait_until_heard(told, publishers_aspect(Level.OK))
        line.judge_until(Verdict.ACCEPT)


class Filter(Node):
    """A user's node between denoise and identifier."""

    def __init__(self) -> None:
        super().__init__('my_filter')
        port, self.passed = ports.DENOISED_WINDOW, 0
        self._windows = self.create_publisher(port.type, 'filtered_window', port.qos)
        self.create_subscription(port.type, port.name, self._on_window, port.stage_qos)

    def _on_window(self, window: Any) -> None:
        self.passed += 1
        self._windows.publish(window)


def test_a_node_between_two_stages_needs_a_remap_and_no_leave(tmp_path: Path):
    values = {
        'driver': {'simulator.count': 0, 'simulator.spacing': 0.5, 'lossless': False},
        'reject': {'rejector_distance': 3.0},
    }
    file = parameter_file(tmp_path / 'line.yaml', values)
    # As line.launch.py hands it to each node.
    remap = ['--remap', 'identifier:denoised_window:=filtered_window']
    commands = {
        name: [*node_command(module, 'own', file), *remap] for name, module in ports.NODES.items()
    }
    with spinning('own') as spinner:
        own = Filter()
        verdicts = heard(own, ports.VERDICT)
        spinner.add(own)
        with running_processes(commands):
            found = [wait_until_heard(verdicts, lambda v: v.decision == Verdict.ACCEPT)]
            found += [verdicts.get(timeout=PATIENCE)[1] for _ in range(4)]
        assert own.passed >= len(found)
        assert not any(is_foreign(verdict) for verdict in found)
