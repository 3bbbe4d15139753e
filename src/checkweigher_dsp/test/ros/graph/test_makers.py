# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the maker of a topic, and of strangers beside it."""

import time

import pytest
from rclpy.node import Node

from checkweigher_dsp.reasons import StopReason
from checkweigher_dsp.records import MassEstimate, StopRequest, foreign
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import to_message
from checkweigher_dsp.ros.graph.makers import ANY, Makers
from checkweigher_dsp.ros.graph.place import Place, participant_of
from checkweigher_dsp.ros.outputs import LOCK
from checkweigher_dsp.ros.port_node import PortNode

STOP = StopRequest(StopReason.DRIVER_TROUBLE, 0)


class Taker(PortNode):
    """A node that takes estimates as they are or as faults, and requests of their maker alone."""

    def __init__(self) -> None:
        self.allowed: set[str] = set()
        self.taken: list[object] = []
        self.refused: list[str] = []
        super().__init__('taker')
        self.entries = [
            self.subscribe(ports.MASS_ESTIMATE, self.taken.append, doubted=foreign),
            self.subscribe(ports.STOP_REQUEST, self.taken.append),
        ]

    def watch_of(self, topic: str, port: ports.Port) -> Makers:
        return Makers(self, topic, port.maker, lambda: self.allowed, stage=True)

    def refuse(self, port: ports.Port, error: Exception) -> None:
        self.refused.append(str(error))

    def warn(self, text: str) -> None:
        self.refused.append(text)


class Graph:
    """A taker, and what publishes beside it."""

    def __init__(self, process) -> None:
        self.process = process
        self.taker = Taker()
        process.spinner.add(self.taker)

    def node(self, name: str) -> Node:
        node = Node(name)
        self.process.spinner.add(node)
        return node

    def publisher(self, node: Node, port: ports.Port):
        publisher = node.create_publisher(port.type, port.name, port.qos)
        self.process.wait_for(publisher.get_subscription_count)
        return publisher

    def taken(self, count: int) -> list[object]:
        self.process.wait_for(lambda: len(self.taker.taken) >= count)
        return self.taker.taken[:count]


@pytest.fixture
def graph(process):
    return Graph(process)


def _estimate(number: int):
    return to_message(ports.MASS_ESTIMATE, MassEstimate(number, 1, 2, 3, mass=0.1, std_dev=1e-4))


def _reasons(records) -> list[tuple[str, ...]]:
    return [record.reasons for record in records]


def test_what_comes_beside_the_maker_is_a_fault_until_the_stranger_has_gone(graph):
    own = graph.publisher(graph.node('identifier'), ports.MASS_ESTIMATE)
    own.publish(_estimate(1))
    assert _reasons(graph.taken(1)) == [()]
    stranger = graph.node('stranger')
    other = graph.publisher(stranger, ports.MASS_ESTIMATE)
    own.publish(_estimate(2))
    other.publish(_estimate(3))
    assert _reasons(graph.taken(3))[1:] == [('ForeignPublisher',)] * 2
    assert graph.taker.entries[0].strangers == ('/stranger',)
    graph.process.spinner.remove(stranger)
    graph.process.wait_for(lambda: not graph.taker.entries[0].doubted)
    own.publish(_estimate(4))
    assert _reasons(graph.taken(4))[3:] == [()]


def test_a_stranger_that_has_gone_before_it_is_heard_is_noticed(graph):
    own = graph.publisher(graph.node('identifier'), ports.MASS_ESTIMATE)
    own.publish(_estimate(1))
    graph.taken(1)
    stranger = Node('stranger')
    with LOCK:  # the node is busy meanwhile
        other = graph.publisher(stranger, ports.MASS_ESTIMATE)
        other.publish(_estimate(2))
        assert other.wait_for_all_acked()
        stranger.destroy_node()
    assert _reasons(graph.taken(2)) == [(), ('ForeignPublisher',)]


def test_the_last_words_of_a_stranger_are_doubted_when_it_has_gone(graph):
    graph.publisher(graph.node('identifier'), ports.MASS_ESTIMATE)
    stranger, taker = Node('stranger'), graph.taker
    other = graph.publisher(stranger, ports.MASS_ESTIMATE)
    other.publish(_estimate(1))
    graph.taken(1)
    with LOCK:  # the node is busy meanwhile
        other.publish(_estimate(2))
        assert other.wait_for_all_acked()
        stranger.destroy_node()
        topic = taker.entries[0].topic_name
        graph.process.wait_for(lambda: len(taker.get_publishers_info_by_topic(topic)) == 1)
    assert _reasons(graph.taken(2)) == [('ForeignPublisher',)] * 2


@pytest.mark.parametrize('allowed', ['/stranger', ANY])
def test_what_is_allowed_is_no_stranger(graph, allowed):
    graph.publisher(graph.node('identifier'), ports.MASS_ESTIMATE)
    graph.taker.allowed = {allowed}
    other = graph.publisher(graph.node('stranger'), ports.MASS_ESTIMATE)
    other.publish(_estimate(1))
    assert _reasons(graph.taken(1)) == [()]


def test_a_node_that_only_has_the_name_of_the_maker_is_a_stranger(graph):
    place = Place(graph.taker.context.get_domain_id(), '/identifier')
    place.sign(b'of another process')
    other = graph.publisher(graph.node('identifier'), ports.MASS_ESTIMATE)
    other.publish(_estimate(1))
    assert _reasons(graph.taken(1)) == [('ForeignPublisher',)]
    place.sign(participant_of(graph.taker))
    graph.process.wait_for(lambda: not graph.taker.entries[0].doubted)
    place.free()


def test_what_is_latched_is_read_again_when_the_stranger_has_gone(graph):
    stranger = graph.node('stranger')
    other = graph.publisher(stranger, ports.STOP_REQUEST)
    other.publish(to_message(ports.STOP_REQUEST, None))
    graph.process.wait_for(lambda: graph.taker.refused)
    own = graph.publisher(graph.node('reject'), ports.STOP_REQUEST)
    own.publish(to_message(ports.STOP_REQUEST, STOP))
    graph.process.wait_for(lambda: len(graph.taker.refused) == 2)
    assert graph.taker.taken == []
    assert 'ForeignPublisher: /stranger' in graph.taker.refused[1]
    graph.process.spinner.remove(stranger)

    def look() -> bool:
        graph.process.spinner.call(lambda: graph.taker.entries[1].look(time.monotonic()))
        return bool(graph.taker.taken)

    graph.process.wait_for(look)
    assert graph.taker.taken == [STOP]
