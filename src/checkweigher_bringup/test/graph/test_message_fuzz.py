# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random messages, bytes, calls and parameters, which end no node and spoil no later stream."""

from collections import Counter
import os
import random
import time
from typing import Any

from checkweigher_msgs.srv import NewBatch, ResetStatistics, SelectProduct
from diagnostic_msgs.msg import DiagnosticArray
from graph import make_stages, play, wait_for
import pytest
from random_messages import garbage_bytes, spoil
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.ros import ports
from checkweigher_production.nodes.product import ProductNode

LANE = 'fuzz'
EXAMPLES = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '0'))
BURST = 50  # messages, after which all must have arrived
FOREIGN = 2**20  # bit in the numbers of the items of the tormentor, which the line does not use


class Tormentor(Node):
    """Sender of random and invalid data."""

    def __init__(self, seed: int) -> None:
        super().__init__('tormentor')
        self.counts: Counter[str] = Counter()
        self._chance = random.Random(seed)
        self._to = [
            (topic, self.create_publisher(topic.type, topic.name, topic.qos)) for topic in ports.ALL
        ]
        self._servers = [
            (self.create_client(kind, name), kind.Request)
            for kind, name in (
                (Trigger, 'zero'), (Trigger, ports.RESET_STOP_REQUEST),
                (SelectProduct, 'select_product'), (NewBatch, 'new_batch'),
                (ResetStatistics, 'reset_statistics'),
            )
        ]  # fmt: skip
        self._targets: list[tuple[Any, list[str]]] = []
        self._calls: list[Future] = []
        self._zeroing: list[Future] = []

    def know(self, nodes: list[Node]) -> None:
        """Add the parameters of nodes to the targets."""
        for node in nodes:
            client = self.create_client(SetParameters, f'{node.get_name()}/set_parameters')
            names = [name for name in node.get_parameters_by_prefix('') if name != 'use_sim_time']
            self._targets.append((client, names))

    def is_heard(self) -> bool:
        """Return whether all subscribers have been discovered."""
        heard = sum(publisher.get_subscription_count() > 0 for _, publisher in self._to)
        return heard >= 9 and all(client.service_is_ready() for client, _ in self._servers)

    def torment(self) -> None:
        """Send one thing, mostly a message."""
        kind = self._chance.choices(
            ['message', 'bytes', 'service', 'parameter'], weights=[80, 10, 5, 5]
        )[0]
        self.counts[kind] += 1
        if kind == 'service':
            client, request = self._chance.choice(self._servers)
            call = client.call_async(spoil(request(), self._chance))
            # That of zero is answered when the belt has been empty, or after 15 s.
            (self._zeroing if client.srv_name.endswith('zero') else self._calls).append(call)
        elif kind == 'parameter':
            client, names = self._chance.choice(self._targets)
            name = self._chance.choice([*names, 'no_such_name'])
            value = spoil(ParameterValue(), self._chance)
            value.type = self._chance.randrange(ParameterType.PARAMETER_STRING_ARRAY + 2)
            parameter = ParameterMessage(name=name, value=value)
            request = SetParameters.Request(parameters=[parameter])
            self._calls.append(client.call_async(request))
        else:
            topic, publisher = self._chance.choice(self._to)
            if kind == 'bytes':
                publisher.publish(garbage_bytes(topic.type, self._chance))
            else:
                message = spoil(topic.type(), self._chance)
                if (
                    topic == ports.ITEMS
                ):  # The line's own numbers would have their verdicts already.
                    message.item_id |= FOREIGN
                publisher.publish(message)

    def wait(self) -> None:
        """Wait until all messages are acknowledged and all calls are answered."""
        for _, publisher in self._to:
            assert publisher.wait_for_all_acked()
        wait_for(lambda: all(call.done() for call in self._calls), timeout=60.0)
        self._calls.clear()

    def finish(self) -> None:
        """Wait until no request can have an effect any more."""
        self.wait()
        wait_for(lambda: all(call.done() for call in self._zeroing), timeout=60.0)


class Counters:
    """Counts of the handled messages in the diagnostics of the nodes.

    An acknowledged message may not be handled yet, and would then belong to the next stream.
    """

    def __init__(self, node: Node, names: list[str]) -> None:
        self._told: dict[str, list[dict[str, int]]] = {name: [] for name in names}
        topic = ports.DIAGNOSTICS
        node.create_subscription(topic.type, topic.name, self._on_diagnostics, topic.qos)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        if message.status and message.status[0].name in self._told:
            pairs = ((pair.key, pair.value) for pair in message.status[0].values)
            counted = {key: int(value) for key, value in pairs if value.isdigit()}
            self._told[message.status[0].name].append(counted)

    def settle(self) -> int:
        """Wait until no count has changed for 1 s, and return the number of refused messages."""
        for told in self._told.values():
            told.clear()
        wait_for(
            lambda: all(len(t) > 1 and t[-1] == t[-2] for t in self._told.values()), timeout=120.0
        )
        last = [told[-1] for told in self._told.values()]
        return sum(n for counted in last for key, n in counted.items() if key.endswith('refused'))


def torment_line(spinner: Spinner, count: int, seed: int) -> Counter[str]:
    """Send `count` random things to a line, check that it weighs a bag, and return the counts."""
    stages = make_stages()
    product = ProductNode()
    listener = ResultListener('listener')
    tormentor = Tormentor(seed)
    counters = Counters(listener, [f'fuzz/{node.get_name()}' for node in (*stages, product)])
    for node in (*stages, product, listener, tormentor):
        spinner.add(node)
    tormentor.know([*stages, product])
    before = [[*node.get_parameters_by_prefix('').values()] for node in stages]
    wait_for(tormentor.is_heard)
    for sent in range(1, count + 1):
        tormentor.torment()
        if sent % BURST == 0:
            tormentor.wait()
            assert spinner.alive
    tormentor.finish()
    tormentor.counts['refused'] = counters.settle()
    spinner.remove(tormentor)  # while it is there, nothing is weighed
    for node, parameters in zip(stages, before, strict=True):
        if node.get_name() != 'segmenter':  # its parameters are read-only
            names = node.parameters.as_mapping()
            own = [Parameter(p.name, p.type_, p.value) for p in parameters if p.name in names]
            assert node.set_parameters_atomically(own).successful
    masses = [weighing.estimate.mass for weighing in play(spinner, listener)]
    assert spinner.alive
    assert masses == pytest.approx([0.0745, 0.1345, 0.1645, 0.1945, 0.2545] * 5, rel=0.03)
    return tormentor.counts


def test_no_random_message_ends_a_node_or_spoils_the_next_line(spinner: Spinner):
    counts = torment_line(spinner, EXAMPLES or 400, 1)

    assert min(counts.values()) > 0


@pytest.mark.soak
def test_many_random_messages(spinner: Spinner):
    begin = time.monotonic()
    counts = torment_line(spinner, EXAMPLES or 20_000, 2)
    print(f'\n{dict(counts)} in {time.monotonic() - begin:.0f} s; all nodes live, 25 of 25 weighed')
