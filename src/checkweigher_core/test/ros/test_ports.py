# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the table of ports."""

import subprocess
import sys

import pytest
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from checkweigher_core.ros import ports
from checkweigher_core.ros.ports import Port


@pytest.mark.parametrize('port', ports.ALL, ids=lambda port: port.name)
def test_a_port_has_a_message_and_ends_that_are_there(port: Port):
    package, _, name = port.message_type.split('/')
    assert port.type.__module__.startswith(package)
    assert port.type.__name__ == name
    assert set(port.expected) <= {port.maker, *port.takers} & set(ports.NODES)


def test_no_two_ports_have_one_name():
    assert len({port.name for port in ports.ALL}) == len(ports.ALL)


@pytest.mark.parametrize(
    ('port', 'depth', 'offered', 'asked'),
    [
        (ports.LOAD_CELL_SAMPLES, 1000, 'VOLATILE', 'VOLATILE'),
        (ports.LOAD_CELL_INFO, 1, 'TRANSIENT_LOCAL', 'TRANSIENT_LOCAL'),
        (ports.VERDICT, 1000, 'TRANSIENT_LOCAL', 'VOLATILE'),
    ],
)
def test_publisher_and_stages_have_the_profiles_of_the_row(
    port: Port, depth: int, offered: str, asked: str
):
    for qos, durability in ((port.qos, offered), (port.stage_qos, asked)):
        assert qos.depth == depth
        assert qos.reliability == ReliabilityPolicy.RELIABLE
        assert qos.durability == DurabilityPolicy[durability]


@pytest.mark.parametrize('port', ports.ALL, ids=lambda port: port.name)
def test_a_stage_takes_what_a_stage_publishes(port: Port):
    assert ports.fits(port.qos, port.stage_qos)


def test_the_permission_runs_out_and_a_subscriber_may_ask_for_less_or_nothing():
    port, limit = ports.PERMISSION, Duration(seconds=ports.FRESH_TIME)
    assert port.qos.lifespan == port.stage_qos.deadline == limit
    assert port.stage_qos.liveliness_lease_duration == limit
    assert not ports.misfit(port.qos, QoSProfile(depth=1))
    short = QoSProfile(depth=1, deadline=Duration(seconds=0.1))
    assert 'deadline' in ports.misfit(port.qos, short)
    assert ports.misfit(QoSProfile(depth=1), port.stage_qos)


def test_what_runs_out_is_in_no_bag():
    assert set(ports.ALL) - set(ports.RECORDED) == {ports.PERMISSION, *ports.ALIVE.values()}


def test_the_table_and_the_conversion_need_no_ros():
    program = (
        'import sys; import checkweigher_core.ros.conversion; '
        "sys.exit(any(name.startswith(('rclpy', 'checkweigher_msgs')) for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, '-c', program]).returncode == 0
