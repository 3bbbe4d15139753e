"""The executors do the same: what rclpy promises of its own holds for ours."""

from collections.abc import Callable
import os
import threading
import time

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
import pytest
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_srvs.srv import Trigger

from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.ros.cached_executor import CachedExecutor
from checkweigher_dsp.ros.executor import EXECUTORS, make_executor

PATIENCE = 20.0  # s


@pytest.fixture(params=EXECUTORS)
def executor(request):
    rclpy.init(domain_id=1 + os.getpid() % 101)
    executor = make_executor(request.param)
    yield executor
    executor.shutdown()
    rclpy.try_shutdown()


@pytest.fixture
def node(executor):
    node = Node('tested')
    executor.add_node(node)
    yield node
    node.destroy_node()


def spin_until(executor: SingleThreadedExecutor, condition: Callable[[], bool]) -> None:
    """Spin until a condition holds."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        executor.spin_once(timeout_sec=0.1)


def message(number: int) -> Time:
    return Time(sec=number)


def connect(executor, node, callback, depth=1000, topic='numbers', **options):
    """Return a publisher that has found a subscription with this callback."""
    node.create_subscription(Time, topic, callback, depth, **options)
    publisher = node.create_publisher(Time, topic, depth)
    spin_until(executor, lambda: publisher.get_subscription_count() > 0)
    return publisher


def test_messages_come_in_order_and_none_is_lost(executor, node):
    heard = []
    publisher = connect(executor, node, lambda m: heard.append(m.sec))

    for number in range(500):
        publisher.publish(message(number))

    spin_until(executor, lambda: len(heard) == 500)
    assert heard == list(range(500))


def test_what_a_callback_publishes_goes_on_through_a_chain(executor, node):
    ends = []
    last = connect(executor, node, lambda m: ends.append(m.sec), topic='third')
    middle = connect(executor, node, last.publish, topic='second')
    first = connect(executor, node, middle.publish, topic='first')

    for number in range(100):
        first.publish(message(number))

    spin_until(executor, lambda: len(ends) == 100)
    assert ends == list(range(100))


def test_a_flood_on_one_topic_does_not_keep_the_other_waiting(executor, node):
    # The one is a stream that never ends: each message has the next one published.
    heard = {'flood': 0, 'rare': 0}

    def on_flood(received):
        heard['flood'] += 1
        flood.publish(received)

    def on_rare(_):
        heard['rare'] += 1

    flood = connect(executor, node, on_flood, topic='flood')
    rare = connect(executor, node, on_rare, topic='rare')
    ticks = []
    node.create_timer(0.001, lambda: ticks.append(heard['flood']))
    flood.publish(message(1))
    spin_until(executor, lambda: heard['flood'] > 10)

    rare.publish(message(1))

    spin_until(executor, lambda: heard['rare'] == 1 and len(ticks) > 10)


def test_a_callback_may_ask_for_the_message_info(executor, node):
    heard = []
    publisher = connect(executor, node, lambda m, info: heard.append((m.sec, set(info))))

    publisher.publish(message(3))

    spin_until(executor, lambda: len(heard) == 1)
    number, info = heard[0]
    assert number == 3
    assert 'source_timestamp' in info


def test_a_callback_may_be_a_coroutine(executor, node):
    heard, answer = [], Future()

    async def on_message(received):
        await answer
        heard.append(received.sec)

    publisher = connect(executor, node, on_message)
    publisher.publish(message(4))
    # The group of the node is taken until the coroutine ends.
    other = ReentrantCallbackGroup()
    node.create_timer(0.05, lambda: answer.set_result(None), callback_group=other)

    spin_until(executor, lambda: heard == [4])


def test_a_timer_can_be_cancelled_reset_and_given_another_period(executor, node):
    ticks = []
    timer = node.create_timer(0.001, lambda: ticks.append(time.monotonic()))
    spin_until(executor, lambda: len(ticks) >= 3)
    timer.cancel()
    counted = len(ticks)
    end = time.monotonic() + 0.1
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.02)
    assert len(ticks) == counted

    timer.timer_period_ns = 50_000_000
    began = time.monotonic()
    timer.reset()

    spin_until(executor, lambda: len(ticks) > counted)
    assert ticks[-1] - began >= 0.045


def test_a_service_answers_while_a_coroutine_of_another_waits(executor, node):
    opened = Future()

    async def wait(request, response):
        await opened
        response.message = 'waited'
        return response

    def at_once(request, response):
        response.message = 'at once'
        return response

    group = ReentrantCallbackGroup()
    node.create_service(Trigger, 'waits', wait, callback_group=group)
    node.create_service(Trigger, 'answers', at_once)
    clients = [node.create_client(Trigger, name) for name in ('waits', 'answers')]
    spin_until(executor, lambda: all(client.service_is_ready() for client in clients))

    slow, fast = (client.call_async(Trigger.Request()) for client in clients)
    spin_until(executor, fast.done)
    assert fast.result().message == 'at once'
    assert not slow.done()
    opened.set_result(None)
    spin_until(executor, slow.done)
    assert slow.result().message == 'waited'


def test_a_group_that_is_taken_keeps_its_messages_for_later(executor, node):
    # A mutually exclusive group, that of the node: no message while its coroutine waits.
    opened, order = Future(), []

    async def wait(request, response):
        order.append('begun')
        await opened
        order.append('ended')
        return response

    node.create_service(Trigger, 'waits', wait)
    client = node.create_client(Trigger, 'waits', callback_group=ReentrantCallbackGroup())
    publisher = connect(executor, node, lambda m: order.append('message'))
    spin_until(executor, client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    spin_until(executor, lambda: order == ['begun'])

    publisher.publish(message(1))
    end = time.monotonic() + 0.2
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.02)
    assert order == ['begun']
    opened.set_result(None)

    spin_until(executor, lambda: len(order) == 3 and answer.done())
    assert order == ['begun', 'ended', 'message']


def test_an_event_of_the_middleware_is_told(executor, node):
    clashes = []
    node.create_subscription(
        Time, 'numbers', lambda m: None, QoSProfile(depth=1),
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=clashes.append),
    )  # fmt: skip
    node.create_publisher(
        Time, 'numbers', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    )

    spin_until(executor, lambda: len(clashes) == 1)
    assert clashes[0].total_count == 1


def test_an_exception_of_a_callback_ends_the_spin_and_the_next_one_goes_on(executor, node):
    heard = []

    def on_message(received):
        if received.sec == 0:
            raise ValueError('no zero')
        heard.append(received.sec)

    publisher = connect(executor, node, on_message)
    publisher.publish(message(0))

    with pytest.raises(ValueError, match='no zero'):
        spin_until(executor, lambda: False)
    publisher.publish(message(1))
    spin_until(executor, lambda: heard == [1])


def test_a_task_of_another_thread_is_done(executor, node):
    done = threading.Event()
    threading.Timer(0.1, lambda: executor.create_task(done.set)).start()

    spin_until(executor, done.is_set)


def test_a_future_ends_the_spin(executor, node):
    answer = Future()
    timer = node.create_timer(0.01, lambda: answer.done() or answer.set_result(5))

    executor.spin_until_future_complete(answer, timeout_sec=PATIENCE)

    assert answer.result() == 5
    timer.cancel()


def test_what_is_made_and_destroyed_in_callbacks_is_served_and_gone(executor, node):
    heard = []
    ends = [node.create_publisher(DiagnosticArray, 'ends', 10)]

    def replace():
        node.destroy_publisher(ends.pop())
        for subscription in list(node.subscriptions):
            node.destroy_subscription(subscription)
        node.create_subscription(DiagnosticArray, 'ends', heard.append, 10)
        ends.append(node.create_publisher(DiagnosticArray, 'ends', 10))

    timer = node.create_timer(0.005, replace)
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.02)
        ends[0].publish(DiagnosticArray())
    timer.cancel()

    spin_until(executor, lambda: ends[0].get_subscription_count() == 1)
    before = len(heard)
    ends[0].publish(DiagnosticArray())
    spin_until(executor, lambda: len(heard) > before)
    # Those that were destroyed are gone from the graph, too.
    spin_until(executor, lambda: node.count_subscribers('ends') == 1)


def test_a_node_is_added_and_removed_while_another_thread_spins(executor, node):
    heard = []
    thread = threading.Thread(target=executor.spin_until_future_complete, args=[ended := Future()])
    thread.start()
    others = []
    for number in range(5):
        other = Node(f'other_{number}')
        other.create_timer(0.001, lambda number=number: heard.append(number))
        executor.add_node(other)
        others.append(other)
    end = time.monotonic() + PATIENCE
    while set(heard) != set(range(5)):
        assert time.monotonic() < end
        time.sleep(0.01)

    def remove():
        for other in others:
            executor.remove_node(other)
            other.destroy_node()
        ended.set_result(None)

    executor.create_task(remove)
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_a_node_with_a_guard_condition_is_served(executor, node):
    calls = []
    guard = node.create_guard_condition(lambda: calls.append(1))

    guard.trigger()

    spin_until(executor, lambda: calls == [1])


def test_one_node_that_wants_the_executor_of_rclpy_has_it_for_its_process():
    rclpy.init()
    try:
        assert isinstance(make_executor('cached'), CachedExecutor)
        for names in (('single_threaded',), ('cached', 'single_threaded')):
            assert not isinstance(make_executor(*names), CachedExecutor)
        with pytest.raises(ParameterError, match="'events' is not one of single_threaded"):
            make_executor('events')
    finally:
        rclpy.try_shutdown()
