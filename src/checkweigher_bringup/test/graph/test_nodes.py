# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes over real DDS: hostile messages to the driver, a bag twice, changed parameters."""

import math

from builtin_interfaces.msg import Time
from checkweigher_msgs.msg import StreamStatus, Verdict
from graph import heard, make_stages, play, publish
from rclpy.node import Node
from rclpy.parameter import Parameter
from running import PATIENCE
from std_msgs.msg import Header

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.listening import EchoNode, ResultListener
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.ros import ports
from checkweigher_driver.driver_node import DriverNode

LANE = 'nodes'


def test_no_message_ends_the_driver(spinner: Spinner):
    spinner.add(DriverNode({'lossless': False, 'simulator.count': 0}))
    tormentor = Node('tormentor')
    spinner.add(tormentor)
    samples = heard(tormentor, ports.LOAD_CELL_SAMPLES, latched=True)
    huge = 2**64 - 1
    publish(tormentor, ports.SEGMENTER_STATUS, StreamStatus(state=99, samples=huge, items=huge))
    publish(tormentor, ports.SEGMENTER_STATUS, StreamStatus())
    publish(tormentor, ports.VERDICT, Verdict(decision=99, item_id=huge))
    before_1970 = Header(stamp=Time(sec=-5))
    publish(tormentor, ports.VERDICT, Verdict(header=before_1970, decision=Verdict.FAULT))
    _, first = samples.get(timeout=PATIENCE)
    while samples.get(timeout=PATIENCE)[1].first_index < first.first_index + 100:
        pass
    assert spinner.alive


def test_the_same_bag_twice_gives_the_same_masses(spinner: Spinner):
    stages = make_stages()
    listener = ResultListener('listener')
    for node in (*stages, listener):
        spinner.add(node)
    first = play(spinner, listener)
    second = play(spinner, listener)
    assert [w.estimate.mass for w in second] == [w.estimate.mass for w in first]
    assert [w.estimate.item_id for w in second] == list(range(26, 51))


def test_limits_can_be_changed_while_the_line_runs_and_bad_ones_are_refused(spinner: Spinner):
    segmenter = STAGE_NODES['segmenter']()
    spinner.add(segmenter)
    (read_only,) = segmenter.set_parameters([Parameter('zero_time', value=0.5)])
    assert not read_only.successful
    node = STAGE_NODES['reject']()
    spinner.add(node)
    good, bad, worse = node.set_parameters(
        [
            Parameter('lower_limit', value=0.1),
            Parameter('upper_limit', value=math.nan),
            Parameter('lower_limit', value=-0.2),
        ]
    )
    assert good.successful
    assert not bad.successful
    assert 'reject.upper_limit' in bad.reason
    assert not worse.successful
    assert node.parameters.lower_limit == 0.1


def test_a_verdict_from_before_its_node_was_discovered_is_shown_without_its_estimate(
    spinner: Spinner,
):
    reject = Node('judge')
    spinner.add(reject)
    accept = Verdict(item_id=7, estimate_id=3, decision=Verdict.ACCEPT, mass=0.15, std_dev=1e-4)
    port = ports.VERDICT
    reject.create_publisher(port.type, port.name, port.qos).publish(accept)
    echo = EchoNode()
    spinner.add(echo)

    weighing = echo.weighings.get(timeout=PATIENCE)

    assert (weighing.verdict.item_id, weighing.estimate.mass) == (7, 0.15)
    assert weighing.estimate.weighed
