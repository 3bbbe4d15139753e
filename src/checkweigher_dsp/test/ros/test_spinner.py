# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are served in a thread of their own."""

import pytest
from rclpy.node import Node

from checkweigher_dsp.ros.port_node import PortNode


def test_nodes_start_in_order_once_they_are_connected(process):
    started = []

    class Starting(PortNode):
        def start(self):
            started.append((self.get_name(), self.executor is not None))

    process.spinner.add(process.node(Starting), process.node(Node), process.node(Starting))

    assert started == [('node_1', True), ('node_3', True)]


def test_an_exception_of_a_callback_ends_the_thread_and_is_kept(process):
    node = process.node()
    node.create_timer(0.001, lambda: 1 / 0)
    process.spinner.add(node)
    process.wait_for(lambda: not process.spinner.alive)
    assert isinstance(process.spinner.error, ZeroDivisionError)


def test_a_call_is_done_in_the_thread_and_raises_what_it_raises(process):
    done = []
    process.spinner.call(lambda: done.append(1))
    assert done == [1]
    with pytest.raises(ZeroDivisionError):
        process.spinner.call(lambda: 1 / 0)
    assert process.spinner.alive


def test_a_node_that_is_removed_is_gone_from_the_graph(process):
    node, other = process.node(), process.node()
    process.spinner.add(node, other)
    process.wait_for(lambda: 'node_1' in other.get_node_names())
    process.spinner.remove(node)
    process.wait_for(lambda: 'node_1' not in other.get_node_names())
