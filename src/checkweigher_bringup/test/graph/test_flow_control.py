# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Replay at full speed, which waits for edges that the network delays."""

from collections import deque
from dataclasses import asdict
import json
from pathlib import Path
import time
from typing import Any

from graph import make_stages, wait_for
from processes import parameter_file
from rclpy.node import Node
from running import BAGS
from verdicts import offline_verdicts

from checkweigher_bringup.spinning import Spinner, node_command, running_processes
from checkweigher_core.records import Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_recording.bags.reading import read_bag

LANE = 'held_up'
BAG = BAGS / 'paper_30'
DELAY = 0.15  # s; at full speed that is ten seconds of signal, and edges may be 2 s late


class SlowEdges(Node):
    """Node that forwards each edge after DELAY."""

    def __init__(self) -> None:
        super().__init__('slow_edges')
        topic = ports.PHOTO_EYES
        self._edges: deque[tuple[float, Any]] = deque()
        self._eyes = self.create_publisher(topic.type, topic.name, topic.qos)
        self.create_subscription(topic.type, 'camera/photo_eyes', self._on_edge, topic.qos)
        self.create_timer(0.005, self._pass_on)

    def _on_edge(self, edge: Any) -> None:
        self._edges.append((time.monotonic() + DELAY, edge))

    def _pass_on(self) -> None:
        while self._edges and self._edges[0][0] < time.monotonic():
            self._eyes.publish(self._edges.popleft()[1])


def test_a_replay_waits_for_edges_that_are_held_up(spinner: Spinner, tmp_path: Path):
    witness, verdicts = PortNode('witness'), list[Verdict]()
    witness.subscribe(ports.VERDICT, verdicts.append)
    for node in (*make_stages(), witness, SlowEdges()):
        spinner.add(node)
    file = parameter_file(
        tmp_path / 'driver.yaml', {'driver': {'source': 'bag', 'bag.path': str(BAG), 'rate': 0.0}}
    )
    driver = node_command(ports.NODES['driver'], LANE, file)
    driver += ['-r', 'photo_eyes:=camera/photo_eyes']
    expected = offline_verdicts(read_bag(BAG))
    with running_processes({'driver': driver}):
        wait_for(lambda: len(verdicts) == len(expected), timeout=60.0)
    found = sorted(verdicts, key=lambda verdict: verdict.item_id)
    assert [json.loads(json.dumps(asdict(verdict))) for verdict in found] == expected
