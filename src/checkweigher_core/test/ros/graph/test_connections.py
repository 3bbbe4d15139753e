# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of connections with endpoints of another DDS participant, whose QoS may not match."""

from collections.abc import Iterator
from functools import partial
import itertools
from types import SimpleNamespace

import pytest
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from checkweigher_core.ros import ports
from checkweigher_core.ros.graph.connections import Connections, has_matched_all
from checkweigher_core.ros.outputs import Output
from checkweigher_core.ros.port_node import PortNode

PORT = ports.VERDICT
# Each test has its own topics, because DDS may still list endpoints of the previous test.
_NUMBERS = itertools.count(1)


@pytest.fixture
def here(process) -> PortNode:
    """Return a node in a lane that no other test uses."""
    return process.node(partial(PortNode, namespace=f'lane_{next(_NUMBERS)}'))


@pytest.fixture
def elsewhere(here) -> Iterator[Node]:
    """Return a node of the same lane with its own DDS participant, as in another process."""
    context = Context()
    context.init(domain_id=here.context.get_domain_id())
    node = Node('elsewhere', context=context, namespace=here.get_namespace())
    yield node
    node.destroy_node()
    context.shutdown()


def subscribe(node: Node, kind: type = PORT.type, qos: QoSProfile = PORT.stage_qos) -> None:
    node.create_subscription(kind, PORT.name, lambda message: None, qos)


def listed_output(process, node: PortNode) -> Output:
    """Return an output as soon as the ROS graph contains its only subscriber."""
    output = node.output(PORT)
    process.wait_for(lambda: node.count_subscribers(PORT.name) == 1)
    return output


def test_a_subscriber_elsewhere_that_asks_for_what_stages_ask_for_fits(process, here, elsewhere):
    subscribe(elsewhere)
    output = listed_output(process, here)

    (listed,) = here.get_subscriptions_info_by_topic(PORT.name)

    assert ports.fits(output.qos, listed.qos_profile)
    process.wait_for(lambda: output.publisher.get_subscription_count() == 1)


@pytest.mark.parametrize(
    ('qos', 'why'),
    [(PORT.qos, ''), (QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT), 'reliab')],
)
def test_a_publisher_elsewhere_fits_unless_it_is_best_effort(process, here, elsewhere, qos, why):
    elsewhere.create_publisher(PORT.type, PORT.name, qos)
    process.wait_for(lambda: here.count_publishers(PORT.name) == 1)

    (listed,) = here.get_publishers_info_by_topic(PORT.name)

    found = ports.misfit(listed.qos_profile, PORT.stage_qos)
    assert why in found
    assert bool(why) == bool(found)


def test_one_that_fits_and_is_not_counted_yet_is_waited_for_and_no_clash(process, here, elsewhere):
    subscribe(elsewhere)
    output = listed_output(process, here)
    process.wait_for(lambda: has_matched_all(here, output))

    # Let the publisher report no subscribers, as it does before DDS has connected them.
    output.publisher = SimpleNamespace(get_subscription_count=lambda: 0)

    assert not has_matched_all(here, output)
    assert 'QoS' not in Connections(here, 0.0).finding(0.0).text


@pytest.mark.parametrize(
    ('kind', 'qos', 'why'),
    [
        (PORT.type, QoSProfile(depth=1, deadline=Duration(seconds=1)), 'deadline'),
        (ports.PHOTO_EYES.type, PORT.stage_qos, ''),
    ],
)
def test_one_that_asks_for_more_or_another_type_is_not_waited_for_and_a_qos_is_named(
    process, here, elsewhere, kind, qos, why
):
    subscribe(elsewhere, kind, qos)
    output = listed_output(process, here)

    assert has_matched_all(here, output)
    assert output.publisher.get_subscription_count() == 0
    assert why in Connections(here, 0.0).finding(0.0).text
