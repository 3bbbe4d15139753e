"""A driver and a network that holds up or loses what it says."""

from collections import deque
from collections.abc import Iterator
from dataclasses import asdict
import json
from pathlib import Path
import time
from typing import Any

from processes import MODULES, command, parameter_file, started
import pytest
from rclpy.node import Node
from running import BAGS
from test_lane_hosts import offline
from test_nodes import make_stages, wait_for

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner, spinning
from checkweigher_driver.bag_reading import read_bag
from checkweigher_dsp.nodes import topics
from checkweigher_dsp.nodes.conversion import verdict_from
from checkweigher_dsp.records import Decision, Eye, Verdict

NAMESPACE = 'held_up'
BAG = BAGS / 'paper_30'
DELAY = 0.15  # s; at full speed that is ten seconds of signal, and edges may be 2 s late


class Witness(Node):
    """Hears the verdicts."""

    def __init__(self) -> None:
        super().__init__('witness')
        topic = topics.VERDICT
        self.verdicts: list[Verdict] = []
        self.create_subscription(
            topic.type, topic.name, lambda m: self.verdicts.append(verdict_from(m)), topic.qos
        )


class SlowEdges(Node):
    """Passes edges on, each DELAY after it has come."""

    def __init__(self) -> None:
        super().__init__('slow_edges')
        topic = topics.PHOTO_EYES
        self._edges: deque[tuple[float, Any]] = deque()
        self._eyes = self.create_publisher(topic.type, topic.name, topic.qos)
        self.create_subscription(topic.type, 'camera/photo_eyes', self._on_edge, topic.qos)
        self.create_timer(0.005, self._pass_on)

    def _on_edge(self, edge: Any) -> None:
        self._edges.append((time.monotonic() + DELAY, edge))

    def _pass_on(self) -> None:
        while self._edges and self._edges[0][0] < time.monotonic():
            self._eyes.publish(self._edges.popleft()[1])


class LateStatus(Node):
    """Passes on what the driver says, the first word of a stream when a product is on the belt."""

    def __init__(self) -> None:
        super().__init__('late_status')
        status, eyes = topics.DRIVER_STATUS, topics.PHOTO_EYES
        self.first: dict[int, Any] = {}
        self._held: Any = None
        self._status = self.create_publisher(status.type, 'late/status', status.qos)
        self.create_subscription(status.type, status.name, self._on_status, status.qos)
        self.create_subscription(eyes.type, eyes.name, self._on_edge, eyes.qos)

    def _on_status(self, message: Any) -> None:
        if message.stream in self.first:
            self._status.publish(message)
        else:
            self._held = self.first[message.stream] = message

    def _on_edge(self, edge: Any) -> None:
        if self._held is not None and edge.eye == Eye.INFEED and not edge.blocked:
            self._status.publish(self._held)
            self._held = None


@pytest.fixture
def spinner() -> Iterator[Spinner]:
    with spinning(NAMESPACE) as running:
        yield running


def test_a_replay_waits_for_edges_that_are_held_up(spinner: Spinner, tmp_path: Path):
    witness = Witness()
    for node in (*make_stages(), witness, SlowEdges()):
        spinner.add(node)
    file = parameter_file(
        tmp_path / 'driver.yaml',
        {'driver': {'source': 'bag', 'bag.path': str(BAG), 'rate': 0.0}},
    )
    driver = [*command(MODULES['driver'], file, NAMESPACE), '-r', 'photo_eyes:=camera/photo_eyes']
    expected = offline(read_bag(BAG))
    with started({'driver': driver}):
        wait_for(lambda: len(witness.verdicts) == len(expected), timeout=60.0)
    found = sorted(witness.verdicts, key=lambda verdict: verdict.item_id)
    assert [json.loads(json.dumps(asdict(verdict))) for verdict in found] == expected


def test_a_stream_that_begins_anew_is_heard_of_though_its_first_word_is_late(
    spinner: Spinner, tmp_path: Path
):
    witness, relay = Witness(), LateStatus()
    stages = [make() for name, make in STAGE_NODES.items() if name != 'reject']
    for node in (*stages, witness, relay):
        spinner.add(node)
    reject = [*command(MODULES['reject'], None, NAMESPACE), '-r', 'load_cell/status:=late/status']
    file = parameter_file(tmp_path / 'driver.yaml', {'driver': {'simulator.count': 2}})
    with started({'reject': reject}):
        for stream in (1, 2):
            # With the stamps of the one before, by which reject knows that it has judged an item.
            with started({'driver': command(MODULES['driver'], file, NAMESPACE)}):
                wait_for(lambda: len(witness.verdicts) == 2 * stream, timeout=60.0)  # noqa: B023
        assert len(relay.first) == 2
    assert [verdict.decision for verdict in witness.verdicts] == [Decision.ACCEPT] * 4
    entered = [verdict.t1 for verdict in witness.verdicts]
    assert entered[2:] == entered[:2]
