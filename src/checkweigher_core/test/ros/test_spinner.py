# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the executor thread and of the nodes whose callbacks it runs."""

from diagnostic_msgs.msg import KeyValue
import pytest
from rclpy.node import Node
from std_srvs.srv import Trigger

from checkweigher_core.ros.port_node import PortNode


def call(process, node, kind, name):
    """Call a service of a node, and return the answer."""
    answer = node.create_client(kind, name).call_async(kind.Request())
    process.wait_for(answer.done)
    return answer.result()


def test_nodes_start_in_order_once_they_are_connected(process):
    started = []

    class Starting(PortNode):
        def start(self):
            started.append((self.get_name(), self.executor is not None))

    first, _, last = nodes = [process.node(Starting), process.node(Node), process.node(Starting)]
    process.spinner.add(*nodes)

    assert started == [(first.get_name(), True), (last.get_name(), True)]


class Failing(PortNode):
    """Node whose callbacks count their calls, and then raise an exception."""

    def __init__(self, name):
        super().__init__(name)
        self.calls = 0
        self.warnings = []

    def warn(self, text):
        self.warnings.append(text)

    def raise_at_once(self, *_):
        self.calls += 1
        raise ZeroDivisionError('first line\nsecond \ud800')

    async def raise_later(self, *arguments):
        self.raise_at_once()

    def answer_what_no_message_can_hold(self, request, response):
        response.message = '\ud800'
        return response


def test_a_node_outlives_what_its_callbacks_raise(process):
    node = process.node(Failing)
    node.create_timer(0.001, node.raise_at_once)
    node.create_timer(0.001, node.raise_later)
    process.spinner.add(node)
    process.wait_for(lambda: node.calls > 10)
    assert process.spinner.alive
    assert 'ZeroDivisionError: first line' in node.warnings[0]


@pytest.mark.parametrize(
    'callback', ['raise_at_once', 'raise_later', 'answer_what_no_message_can_hold']
)
def test_a_call_that_fails_is_answered_with_an_empty_response(process, callback):
    node = process.node(Failing)
    node.create_service(Trigger, 'fail', getattr(node, callback))
    process.spinner.add(node)
    for _ in range(2):  # the second call shows that the callback group is not blocked
        answer = call(process, node, Trigger, 'fail')
        assert (answer.success, answer.message) == (False, '')
    assert len(node.warnings) == 2
    assert 'refused a call of fail' in node.warnings[0]


def listening(process):
    """Return a node, a list of the keys that it has received, and a connected publisher."""
    node, heard = process.node(Failing), []
    node.create_subscription(KeyValue, 'text', lambda message: heard.append(message.key), 10)
    process.spinner.add(node)
    publisher = node.create_publisher(KeyValue, 'text', 10)
    process.wait_for(publisher.get_subscription_count)
    return node, heard, publisher


@pytest.mark.parametrize('bytes_', [b'', b'\0\1\0\0' + b'\xff' * 8, b'\0\1\0\0\2\0\0\0\xff\0'])
def test_a_subscription_outlives_bytes_that_are_no_message(process, bytes_):
    _, heard, publisher = listening(process)
    publisher.publish(bytes_)
    publisher.publish(KeyValue(key='whole'))
    process.wait_for(lambda: 'whole' in heard)


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
    name = node.get_name()
    process.wait_for(lambda: name in other.get_node_names())
    process.spinner.remove(node)
    process.wait_for(lambda: name not in other.get_node_names())
