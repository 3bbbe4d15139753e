# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clock of a bag for nodes with use_sim_time."""

from lines import weigh_all
from rclpy.node import Node
from rclpy.parameter import Parameter
from running import BAGS, wait_for

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.records import NANOSECONDS
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_recording.bags.reading import read_bag

BAG = BAGS / 'paper_90'
SIMULATED = {'use_sim_time': True}


def test_a_bag_gives_its_time_to_nodes_that_use_it(spinner: Spinner):
    watch = Node('watch', parameter_overrides=[Parameter('use_sim_time', value=True)])
    listener = ResultListener('results')
    stages = [
        make({**SIMULATED, **({'deadlines': False} if name == 'reject' else {})})
        for name, make in STAGE_NODES.items()
    ]
    bag = {'source': 'bag', 'bag.path': str(BAG), 'rate': 0.0, 'publish_clock': True}
    spinner.add(watch, listener, *stages, DriverNode({**SIMULATED, **bag}))
    recording = read_bag(BAG)
    expected = list(weigh_all(recording, LineParameters()))
    found = [listener.weighings.get(timeout=60) for _ in expected]
    assert [each.estimate for each in found] == [each.estimate for each in expected]
    end = recording.blocks[-1].stamp
    wait_for(lambda: end - NANOSECONDS < watch.get_clock().now().nanoseconds <= end)
