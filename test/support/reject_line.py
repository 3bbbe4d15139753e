# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A reject node alone, with a test in the place of the other nodes of its line."""

from dataclasses import replace

from checkweigher_msgs.msg import StopRequest, Verdict
from graph import call, heard, publish, wait_for
from rclpy.node import Node
from running import PATIENCE
from std_srvs.srv import Trigger

from checkweigher_bringup.spinning import Spinner
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, Item, LoadCell, MassEstimate
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_dsp.nodes.reject import RejectNode

CELL = LoadCell(960.0, 5e5, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2)
START = 1_700_000_000 * NANOSECONDS


def edges(number: int) -> list[EyeEdge]:
    """Edges of an item of 0.1 m at 0.5 m/s."""
    t1 = START + number * NANOSECONDS
    steps = ((0, Eye.INFEED, True), (2, Eye.INFEED, False), (4, Eye.OUTFEED, True))
    return [EyeEdge(t1 + step * NANOSECONDS // 10, eye, blocked) for step, eye, blocked in steps]


def estimate(number: int, mass: float, **more: float) -> MassEstimate:
    """Return the estimate of an item, numbered from 1."""
    t1, t2, t3 = (edge.stamp for edge in edges(number))
    return MassEstimate(number, t1, t2, t3, mass=mass, std_dev=1e-4, line_speed=0.5, **more)


class RejectLine:
    """A reject node, and a node that publishes and hears what the others of a line would."""

    def __init__(self, spinner: Spinner, **parameters: object) -> None:
        self.node = Node('others')
        self.verdicts = heard(self.node, ports.VERDICT)
        self.stops = heard(self.node, ports.STOP_REQUEST, latched=True)
        self._diagnostics = heard(self.node, ports.DIAGNOSTICS)
        self.edges, self.items = (
            self.node.create_publisher(port.type, port.name, port.qos)
            for port in (ports.PHOTO_EYES, ports.ITEMS)
        )
        spinner.add(self.node)
        self.reject = RejectNode(parameters)
        spinner.add(self.reject)
        wait_for(self.edges.get_subscription_count)
        wait_for(self.items.get_subscription_count)
        info = to_message(ports.LOAD_CELL_INFO, CELL, stamp=START)
        publish(self.node, ports.LOAD_CELL_INFO, info)
        # Edges come on another topic: they must not overtake it.
        self.wait_for_count('load_cell/info received', 1)

    def wait_for_count(self, name: str, count: int) -> None:
        """Wait until the diagnostics of the reject node show a count."""
        counted: dict[str, str] = {}
        while counted.get(name) != str(count):
            status, *_ = self._diagnostics.get(timeout=PATIENCE)[1].status
            if status.name.endswith('/reject'):
                counted = {value.key: value.value for value in status.values}

    def reset(self) -> bool:
        """Reset the stop request, and return whether that was done."""
        return bool(call(self.node, Trigger, ports.RESET_STOP_REQUEST).success)

    def weigh(self, number: int, **more: float) -> None:
        """Publish the mass of an item."""
        message = to_message(ports.MASS_ESTIMATE, estimate(number, 0.15, **more))
        publish(self.node, ports.MASS_ESTIMATE, message)

    def pass_item(self, number: int) -> None:
        """Let an item pass the eyes, announced as it leaves."""
        for edge in edges(number):
            self.edges.publish(to_message(ports.PHOTO_EYES, edge))
        self.announce(number)

    def announce(self, number: int, **others: object) -> None:
        """Announce an item that is complete."""
        t1, t2, t3 = (edge.stamp for edge in edges(number))
        item = replace(Item(t1, 0, number, t1, t2, t3, 0.5, True), **others)
        self.items.publish(to_message(ports.ITEMS, item))

    def verdict(self) -> Verdict:
        """Return the next verdict."""
        return self.verdicts.get(timeout=PATIENCE)[1]

    def stop(self) -> StopRequest:
        """Return the next word on whether to stop."""
        return self.stops.get(timeout=PATIENCE)[1]
