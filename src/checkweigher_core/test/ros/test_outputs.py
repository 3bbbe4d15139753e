# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of outputs, which send each record once: by a call within a process, otherwise by DDS."""

import threading
import time

import pytest
from rclpy.logging import LoggingSeverity
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_srvs.srv import Trigger

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import Decision, Eye, EyeEdge, LoadCell, Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.outputs import LOCK, connect
from checkweigher_core.ros.port_node import PortNode

LONG_ENOUGH = 0.3  # time in s for which a test waits for a record that must not arrive


def edge(stamp: int) -> EyeEdge:
    return EyeEdge(stamp, Eye.INFEED, True)


def verdict(number: int) -> Verdict:
    return Verdict(number, 1_000_000_000 * number, Decision.ACCEPT)


@pytest.fixture
def pair(process):
    """Return an output, the records that another node in the process received, and this node."""
    maker, taker = process.node(), process.node()
    output = maker.output(ports.PHOTO_EYES)
    taken = []
    taker.subscribe(ports.PHOTO_EYES, taken.append)
    process.spinner.add(maker, taker)
    return output, taken, taker


def test_the_record_itself_arrives_before_send_returns_and_no_subscription_is_made(pair):
    output, taken, taker = pair
    sent = edge(1)

    output.send(sent)

    assert taken[0] is sent
    assert output.publisher.get_subscription_count() == 0
    assert (output.count(), taker.inputs[0].count()) == (1, 1)


def test_a_subscriber_elsewhere_has_each_record_once_and_so_has_the_process(process, pair):
    output, taken, _ = pair
    watcher, watched = process.node(), []
    watcher.subscribe(ports.PHOTO_EYES, watched.append)
    process.spinner.add(watcher)  # added separately, so that it subscribes as in another process
    process.wait_for(lambda: output.publisher.get_subscription_count() == 1)

    for stamp in range(1, 101):
        output.send(edge(stamp))

    process.wait_for(lambda: len(watched) == 100)
    time.sleep(LONG_ENOUGH)
    assert watched == taken == [edge(stamp) for stamp in range(1, 101)]


def test_what_a_stranger_publishes_between_two_nodes_of_a_process_is_not_taken(process, pair):
    _, taken, taker = pair
    topic = ports.PHOTO_EYES
    stranger = process.node()
    process.spinner.add(stranger)
    publisher = stranger.create_publisher(topic.type, topic.name, topic.qos)

    publisher.publish(to_message(topic, edge(1)))

    time.sleep(LONG_ENOUGH)
    assert taken == []
    assert list(taker.subscriptions) == []


def test_a_latched_record_reaches_a_subscriber_that_comes_later(process):
    maker, late, taken = process.node(), process.node(), []
    output = maker.output(ports.LOAD_CELL_INFO)
    process.spinner.add(maker)
    cell = LoadCell(960.0, 1e5, 0.0, -(2**23), 2**23, 1.0, 0.3)
    output.send(cell, stamp=5)

    late.subscribe(ports.LOAD_CELL_INFO, taken.append)
    process.spinner.add(late)

    process.wait_for(lambda: len(taken) == 1)
    assert taken == [cell]


def test_an_input_whose_qos_does_not_fit_is_no_taker(process):
    maker, taker, taken = process.node(), process.node(), []
    output = maker.output(ports.PHOTO_EYES)
    output.qos.reliability = ReliabilityPolicy.BEST_EFFORT
    taker.subscribe(ports.PHOTO_EYES, taken.append)

    process.spinner.add(maker, taker)

    output.send(edge(1))
    assert taken == []
    assert len(list(taker.subscriptions)) == 1


def test_remapped_topics_are_told_apart(process):
    maker = process.node()
    taker = PortNode('taker', cli_args=['--ros-args', '-r', 'photo_eyes:=others'])
    output, taken = maker.output(ports.PHOTO_EYES), []
    taker.subscribe(ports.PHOTO_EYES, taken.append)

    process.spinner.add(maker, taker)

    output.send(edge(1))
    assert taken == []
    assert taker.inputs[0].topic_name == '/others'


def test_a_record_that_a_callback_cannot_use_is_refused_and_the_next_one_comes(process):
    maker, taker, other, taken, refused = process.node(), process.node(), process.node(), [], []

    def take(record):
        if record.stamp == 1:
            raise ValueError('not this one')
        taken.append(record)

    output = maker.output(ports.PHOTO_EYES)
    taker.subscribe(ports.PHOTO_EYES, take)
    taker.refuse = lambda port, error: refused.append((port.name, str(error)))
    other.subscribe(ports.PHOTO_EYES, taken.append)
    process.spinner.add(maker, taker, other)

    output.send(edge(1))
    output.send(edge(2))

    assert refused == [('photo_eyes', 'not this one')]
    assert taken == [edge(1), edge(2), edge(2)]


def test_a_message_that_is_no_record_is_refused(process):
    taker, taken, refused = process.node(), [], []
    topic = ports.PHOTO_EYES
    taker.subscribe(topic, taken.append)
    taker.refuse = lambda port, error: refused.append(port.name)
    process.spinner.add(taker)
    publisher = taker.create_publisher(topic.type, topic.name, topic.qos)
    process.wait_for(lambda: publisher.get_subscription_count() == 1)
    message = to_message(topic, edge(1))
    message.eye = 9

    publisher.publish(message)
    publisher.publish(to_message(topic, edge(2)))

    process.wait_for(lambda: len(taken) == 1)
    assert refused == ['photo_eyes']
    assert taken == [edge(2)]


def test_callbacks_of_a_process_never_run_at_the_same_time(process, pair):
    output, _, taker = pair
    busy, together, ticks = [], [], []

    def work(*_):
        busy.append(1)
        together.append(len(busy))
        time.sleep(0.0005)
        busy.pop()

    taker.inputs[0].take = work
    taker.create_timer(0.001, lambda: (work(), ticks.append(1)))

    def source():
        for stamp in range(1, 201):
            output.send(edge(stamp))

    threads = [threading.Thread(target=source) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    process.wait_for(lambda: len(ticks) > 5)
    assert set(together) == {1}


def test_a_coroutine_leaves_the_lock_while_it_waits(process):
    node, steps, future = process.node(), [], Future()

    async def wait():
        timer.cancel()
        steps.append('began')
        await future
        steps.append('ended')

    timer = node.create_timer(0.001, wait)
    process.spinner.add(node)
    process.wait_for(lambda: steps == ['began'])
    with LOCK:  # this thread can take the lock while the callback awaits the future
        future.set_result(None)
    node.executor.wake()
    process.wait_for(lambda: steps == ['began', 'ended'])


def test_a_node_that_is_destroyed_is_called_no_more(process, pair):
    output, taken, taker = pair
    output.send(edge(1))
    process.spinner.remove(taker)
    output.send(edge(2))
    assert taken == [edge(1)]
    assert output.count() == 0


def test_an_integrator_sets_depth_and_reliability_by_parameters(process):
    def overridden(end, name, value):
        parameter = Parameter(f'qos_overrides./photo_eyes.{end}.{name}', value=value)
        return PortNode(f'{end}_{name}', parameter_overrides=[parameter])

    maker, taker = overridden('publisher', 'depth', 7), overridden('subscription', 'depth', 9)
    output = maker.output(ports.PHOTO_EYES)
    taker.subscribe(ports.PHOTO_EYES, lambda record: None)
    process.spinner.add(maker)
    process.spinner.add(taker)

    assert output.publisher.qos_profile.depth == 7
    assert next(iter(taker.subscriptions)).qos_profile.depth == 9
    assert ports.PHOTO_EYES.qos == QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)


@pytest.mark.parametrize(('name', 'value'), [('reliability', 'perhaps'), ('depth', 'deep')])
def test_a_qos_that_cannot_be_used_is_refused_in_one_line(process, name, value):
    parameter = Parameter(f'qos_overrides./photo_eyes.publisher.{name}', value=value)
    node = PortNode('refused', parameter_overrides=[parameter])
    with pytest.raises(ParameterError, match='qos_overrides'):
        node.output(ports.PHOTO_EYES)
    node.destroy_node()


def test_verdicts_are_held_until_there_is_a_consumer_over_dds(process):
    maker, taker, taken, before = process.node(), process.node(), [], []
    output = maker.held_output(ports.VERDICT, before=before.append)
    process.spinner.add(maker)
    for number in range(1, 4):
        output.send(verdict(number))
    assert before == []

    taker.subscribe(ports.VERDICT, taken.append)
    process.spinner.add(taker)

    process.wait_for(lambda: len(taken) == 3)
    output.send(verdict(4))
    process.wait_for(lambda: len(taken) == 4)
    assert [each.item_id for each in taken] == [1, 2, 3, 4]
    assert before == taken


def test_a_consumer_in_the_process_has_all_from_the_start(process):
    maker, taker, taken = process.node(), process.node(), []
    output = maker.held_output(ports.VERDICT)
    output.send(verdict(1))
    taker.subscribe(ports.VERDICT, taken.append)
    connect([maker, taker])
    output.send(verdict(2))
    assert [each.item_id for each in taken] == [1, 2]


def test_a_refused_call_is_answered_with_its_reason_and_logged(process, capfd):
    node, client_node = process.node(), process.node()
    # A command that was run in this process may have set another level.
    node.get_logger().set_level(LoggingSeverity.INFO)

    def refuse(request, response):
        raise ValueError('the belt runs')

    service = node.create_service(Trigger, 'refuse', refuse)
    process.spinner.add(node, client_node)
    client = client_node.create_client(Trigger, service.srv_name)
    process.wait_for(client.service_is_ready)
    called = client.call_async(Trigger.Request())
    process.wait_for(called.done)

    assert (called.result().success, called.result().message) == (False, 'the belt runs')
    assert 'refuse: refused: the belt runs' in ''.join(capfd.readouterr())
