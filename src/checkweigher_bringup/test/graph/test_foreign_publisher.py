# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Foreign publisher on the topics of a line."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from checkweigher_msgs.msg import MassEstimate, StopRequest, Verdict
from graph import heard, wait_for
from rclpy.node import Node
from running import PATIENCE
from std_srvs.srv import Trigger
from supervised_line import supervised_line

from checkweigher_core.health.findings import Level
from checkweigher_core.ros import ports

SAYS = '/running/stranger publishes /running/mass_estimate'


def wait_until_heard(messages: Any, wanted: Callable[[Any], bool]) -> Any:
    """Return the next message that meets a condition."""
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
