"""Messages within a process: each comes once, in order, one at a time, whoever publishes."""

from collections.abc import Callable
import os
import threading
import time

from builtin_interfaces.msg import Time
import pytest
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from checkweigher_dsp.nodes.denoise import DenoiseNode
from checkweigher_dsp.ros.alarm import Alarm
from checkweigher_dsp.ros.delivery import DeliveringPublisher, current, delivering
from checkweigher_dsp.ros.executor import EXECUTORS, make_executor

PATIENCE = 20.0  # s
DEPTH = QoSProfile(depth=1000)


class Process:
    """A process of nodes: an executor, what it delivers, and one node that it serves."""

    def __init__(self, kind: str, delivery) -> None:
        self.delivery = delivery
        self.executor = make_executor(kind, delivery=delivery)
        self.nodes: list[Node] = []
        self.node = self.add('tested')

    def add(self, name: str) -> Node:
        """Return one more node."""
        node = Node(name)
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def publisher(self, topic: str = 'numbers', qos: QoSProfile = DEPTH) -> DeliveringPublisher:
        publisher = self.node.create_publisher(
            Time, topic, qos, publisher_class=DeliveringPublisher
        )
        self.delivery.add_publisher(publisher)
        return publisher

    def subscribe(self, callback, topic: str = 'numbers', qos: QoSProfile = DEPTH, at=None):
        """Subscribe by a node of its own, as stages do."""
        at = at or Node(f'taker_{len(self.nodes)}')
        subscription = self.delivery.subscribe(at, Time, topic, callback, qos)
        self.nodes.append(at)
        self.executor.add_node(at)
        return subscription

    def watch(self, callback, topic: str = 'numbers', qos: QoSProfile = DEPTH) -> None:
        """Subscribe as somebody outside does, over DDS."""
        self.node.create_subscription(Time, topic, callback, qos)

    def spin_until(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.1)

    def spin_for(self, seconds: float) -> None:
        """Spin for as long as what must not come could take to come."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)


# Longer than the period in which leftovers of DDS are looked at.
LONG_ENOUGH = 1.5  # s


@pytest.fixture(params=EXECUTORS)
def process(request):
    rclpy.init(domain_id=100 + os.getpid() % 100)
    with delivering() as delivery:
        process = Process(request.param, delivery)
        yield process
        process.executor.shutdown()
        for node in process.nodes:
            node.destroy_node()
    rclpy.try_shutdown()


def message(number: int) -> Time:
    return Time(sec=number)


def numbers(heard: list[Time]) -> list[int]:
    return [each.sec for each in heard]


def test_the_message_itself_arrives_before_publishing_returns(process):
    heard = []
    process.subscribe(heard.append)
    publisher = process.publisher()
    sent = [message(number) for number in range(5)]

    for each in sent:
        publisher.publish(each)

    assert all(came is each for came, each in zip(heard, sent, strict=True))
    process.spin_for(LONG_ENOUGH)
    assert numbers(heard) == list(range(5))


def test_what_a_callback_publishes_comes_after_it_in_the_order_of_publication(process):
    order = []
    second = process.publisher('second')

    def on_first(received):
        second.publish(message(10 * received.sec))
        second.publish(message(10 * received.sec + 1))
        order.append(('first', received.sec))

    process.subscribe(on_first, 'first')
    process.subscribe(lambda m: order.append(('second', m.sec)), 'second')
    process.subscribe(lambda m: order.append(('again', m.sec)), 'second')
    first = process.publisher('first')

    first.publish(message(1))
    first.publish(message(2))

    assert order == [
        ('first', 1), ('second', 10), ('again', 10), ('second', 11), ('again', 11),
        ('first', 2), ('second', 20), ('again', 20), ('second', 21), ('again', 21),
    ]  # fmt: skip


def test_threads_take_turns_and_each_message_comes_once_and_in_order(process):
    heard, busy, together = [], [], []

    def on_message(received):
        busy.append(1)
        together.append(len(busy))
        heard.append((received.nanosec, received.sec))
        busy.pop()

    process.subscribe(on_message)
    publisher = process.publisher()
    ticks = []

    def tick():
        busy.append(1)
        together.append(len(busy))
        ticks.append(1)
        publisher.publish(Time(nanosec=0, sec=len(ticks)))
        busy.pop()

    process.node.create_timer(0.001, tick)

    def source(number: int) -> None:
        for each in range(1, 1001):
            publisher.publish(Time(nanosec=number, sec=each))

    threads = [threading.Thread(target=source, args=(number,)) for number in (1, 2)]
    for thread in threads:
        thread.start()
    process.spin_until(lambda: len(ticks) >= 20 and not any(t.is_alive() for t in threads))
    process.spin_until(lambda: len(heard) == 2000 + len(ticks))

    assert set(together) == {1}
    for thread, count in ((0, len(ticks)), (1, 1000), (2, 1000)):
        assert [number for who, number in heard if who == thread] == list(range(1, count + 1))


def test_timers_have_their_turn_while_messages_never_end(process):
    ticks, first = [], process.publisher()
    process.subscribe(first.publish)  # each has the next one published
    process.node.create_timer(0.01, lambda: ticks.append(1))

    threading.Thread(target=first.publish, args=(message(1),), daemon=True).start()

    process.spin_until(lambda: len(ticks) >= 3)


@pytest.mark.parametrize('elsewhere', [False, True], ids=['executor', 'another-thread'])
def test_an_exception_ends_the_spin_and_the_next_message_comes(process, elsewhere):
    heard = []

    def on_message(received):
        if received.sec == 0:
            raise ValueError('no zero')
        heard.append(received.sec)

    process.subscribe(on_message)
    publisher = process.publisher()

    def source():
        publisher.publish(message(0))
        publisher.publish(message(1))

    if elsewhere:
        thread = threading.Thread(target=source)
        thread.start()
        thread.join()
    else:
        timer = process.node.create_timer(0.01, lambda: (timer.cancel(), source()))

    with pytest.raises(ValueError, match='no zero'):
        process.spin_for(PATIENCE)
    process.spin_until(lambda: heard == [1])
    publisher.publish(message(2))
    assert heard == [1, 2]


def test_a_watcher_has_all_and_the_nodes_of_the_process_have_each_once(process):
    heard, watched = [], []
    process.subscribe(heard.append)
    publisher = process.publisher()
    publisher.publish(message(0))  # nobody watches yet
    process.watch(watched.append)

    for number in range(1, 200):
        publisher.publish(message(number))

    process.spin_until(lambda: len(watched) == 199)
    process.spin_for(LONG_ENOUGH)
    assert numbers(watched) == list(range(1, 200))
    assert numbers(heard) == list(range(200))


@pytest.mark.parametrize('watched', [False, True])
def test_what_somebody_else_publishes_there_comes_once_beside_it(process, watched):
    heard = []
    process.subscribe(heard.append)
    own = process.publisher()
    if watched:  # what is published here goes over DDS, too
        process.watch(lambda m: None)
    own.publish(message(0))
    stranger = process.node.create_publisher(Time, 'numbers', DEPTH)

    for number in range(1, 100):
        own.publish(message(number))
        stranger.publish(message(-number))
    process.node.destroy_publisher(stranger)  # as one that comes, says it and goes

    process.spin_until(lambda: len(heard) >= 199)
    process.spin_for(LONG_ENOUGH)
    assert [each for each in numbers(heard) if each >= 0] == list(range(100))
    assert [-each for each in numbers(heard) if each < 0] == list(range(1, 100))


def test_the_timers_of_a_new_node_come_before_its_messages(process):
    order = []
    stranger = process.node.create_publisher(Time, 'numbers', DEPTH)
    process.publisher()
    node = Node('late')
    node.create_timer(0.0, lambda: order.append('timer'))
    process.subscribe(lambda m: order.append('message'), at=node)
    stranger.publish(message(1))

    process.spin_until(lambda: 'message' in order)
    assert order[0] == 'timer'


@pytest.mark.parametrize('own', [False, True])
def test_one_that_stays_is_heard_without_delay(process, own):
    heard = []
    process.subscribe(heard.append)
    if own:
        process.publisher()
    stranger = process.node.create_publisher(Time, 'numbers', DEPTH)
    stranger.publish(message(1))
    process.spin_until(lambda: len(heard) == 1)

    began = time.monotonic()
    for number in range(2, 102):
        stranger.publish(message(number))
        process.spin_until(lambda number=number: len(heard) == number)
    assert time.monotonic() - began < PATIENCE  # 100 s if each waited for the next look


def test_the_first_message_is_not_kept_waiting_where_nobody_else_publishes(process):
    heard = []
    process.subscribe(heard.append)
    process.spin_for(0.1)
    strangers = []
    began = time.monotonic()
    for number in range(1, 31):
        strangers.append(process.node.create_publisher(Time, 'numbers', DEPTH))
        strangers[-1].publish(message(number))
        process.spin_until(lambda number=number: len(heard) == number)
        process.node.destroy_publisher(strangers.pop())
    assert time.monotonic() - began < PATIENCE  # 30 s if each waited for the next look


def test_results_from_before_a_subscription_was_there_come_over_dds(process):
    kept = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = process.publisher(qos=kept)
    publisher.publish(message(1))
    heard = []

    process.subscribe(heard.append, qos=kept)
    publisher.publish(message(2))

    process.spin_until(lambda: len(heard) == 2)
    process.spin_for(LONG_ENOUGH)
    assert numbers(heard) == [1, 2]


def test_ends_whose_qos_does_not_fit_have_nothing_of_each_other(process):
    heard = []
    process.subscribe(heard.append)
    process.publisher(qos=QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)).publish(
        message(1)
    )
    process.spin_for(LONG_ENOUGH)
    assert heard == []


def test_one_that_is_gone_hears_nothing_and_the_others_go_on(process):
    heard, gone = [], []
    unsubscribed = Node('unsubscribed')
    subscription = process.subscribe(gone.append, at=unsubscribed)
    removed = Node('removed')
    process.subscribe(gone.append, at=removed)
    process.subscribe(heard.append)
    publisher = process.publisher()
    process.watch(lambda m: None)
    publisher.publish(message(1))

    process.delivery.forget(subscription)
    unsubscribed.destroy_subscription(subscription)
    process.executor.remove_node(removed)
    publisher.publish(message(2))
    process.delivery.forget(publisher)
    process.node.destroy_publisher(publisher)

    process.spin_for(LONG_ENOUGH)
    assert numbers(gone) == [1, 1]
    assert numbers(heard) == [1, 2]


def test_what_is_no_message_of_the_topic_is_refused(process):
    process.subscribe(lambda m: None)
    with pytest.raises(TypeError, match='numbers'):
        process.publisher().publish(5)


def test_an_alarm_rings_once_at_the_time_set_last(process):
    rung = []
    alarm = Alarm(process.node, lambda: rung.append(time.monotonic_ns()))
    process.spin_for(0.1)
    began = time.monotonic_ns()

    def set_it():
        alarm.set(began + 10**10)
        alarm.set(began + 10**6)
        alarm.clear()
        alarm.set(began + 2 * 10**8)

    # The executor waits already, for longer than that.
    thread = threading.Timer(0.05, set_it)
    thread.start()
    while not rung:
        assert time.monotonic_ns() - began < 5 * 10**9
        process.executor.spin_once(timeout_sec=5.0)

    assert rung[0] >= began + 2 * 10**8
    alarm.set(time.monotonic_ns() + 10**7)
    alarm.clear()
    process.spin_for(0.2)
    assert len(rung) == 1


def test_a_node_may_have_all_over_dds_and_so_has_one_outside_of_a_process(process):
    def publishes(node: DenoiseNode) -> type:
        kinds = {type(each) for each in node.publishers if each.topic_name == '/denoised_window'}
        node.destroy_node()
        return kinds.pop()

    assert publishes(DenoiseNode()) is DeliveringPublisher
    assert publishes(DenoiseNode({'transport': 'dds'})) is not DeliveringPublisher


def test_nothing_is_handed_over_where_nobody_began_it():
    assert current() is None
