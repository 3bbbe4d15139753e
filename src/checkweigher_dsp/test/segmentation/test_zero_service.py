# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The service zero of the segmenter node, over real DDS."""

import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from running import PATIENCE
from std_srvs.srv import Trigger

from checkweigher_core.ros.ports import ZERO_SETTING
from checkweigher_dsp.nodes.segmenter import SegmenterNode


@pytest.fixture
def executor():
    rclpy.init()
    executor = SingleThreadedExecutor()
    yield executor
    for node in executor.get_nodes():
        node.destroy_node()  # its place is for that of the next test
    rclpy.shutdown()


def _call(executor, node):
    executor.add_node(node)
    client = node.create_client(Trigger, 'zero')
    deadline = time.monotonic() + 20
    while not client.service_is_ready() and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.1)
    future = client.call_async(Trigger.Request())
    executor.spin_until_future_complete(future, timeout_sec=PATIENCE)
    return future


def test_without_a_load_cell_the_service_says_so(executor):
    future = _call(executor, SegmenterNode())

    assert not future.result().success
    assert future.result().message == 'no load_cell/info has come: not zeroed'


def test_the_service_answers_when_the_belt_was_zeroed(executor, make_line):
    line = make_line((0.1,), first_entry=8.0)
    node = SegmenterNode()
    node._start(line.load_cell)
    settings = []
    topic = ZERO_SETTING
    node.create_subscription(topic.type, topic.name, settings.append, topic.qos)
    blocks = iter(line.blocks(size=96))
    # The signal goes on once the request is there.
    node.create_timer(0.005, lambda: node._zero_requests and node._on_event(next(blocks)))

    future = _call(executor, node)

    assert future.result().success
    assert future.result().message.startswith('zeroed at 0.000000 kg')
    deadline = time.monotonic() + 20
    while not settings and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.1)
    (setting,) = settings
    assert (setting.zero, setting.previous) == pytest.approx((0.0, 0.0), abs=1e-6)
