# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Strangers on the graph of a line: each does one thing for a while, under any name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import math
import random
import time
from typing import Any

from random_messages import garbage_bytes, spoil
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node

from checkweigher_dsp.records import Decision, Eye, EyeEdge, MassEstimate, StreamState, Verdict
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import stamp_from, to_message, to_record
from checkweigher_dsp.ros.ports import Port

FALSE = 0.9  # kg, of forged estimates: no product of the line has that
FORGED = 10**6  # added to the numbers of forged verdicts
_PERIOD = 0.02  # s
_EVENTS = Port(
    '/parameter_events', 'rcl_interfaces/msg/ParameterEvent', None, ports.STREAM, '', (), (), ''
)


class Stranger(Node):
    """A node that is no part of the line; it hears the line's edges and calibration."""

    def __init__(self, name: str = 'stranger') -> None:
        super().__init__(name)
        self.chance = random.Random(7)
        self.edges: list[EyeEdge] = []
        self.info: Any = None
        self.made_up: set[int] = set()  # stamps of edges that no eye saw, ns
        self.on_item: Callable[[EyeEdge, EyeEdge], None] | None = None
        self._hear(ports.PHOTO_EYES, self._on_edge)
        self._hear(ports.LOAD_CELL_INFO, self._on_info)
        self._to: dict[str, Any] = {}

    def _hear(self, port: Port, callback: Callable[[Any], None]) -> None:
        self.create_subscription(port.type, port.name, callback, port.stage_qos)

    def _on_info(self, message: Any) -> None:
        self.info = self.info or message

    def _on_edge(self, message: Any) -> None:
        edge = to_record(ports.PHOTO_EYES, message)
        self.edges = [*self.edges[-7:], edge]
        entered = [e for e in self.edges if e.eye is Eye.INFEED and e.blocked]
        if edge.eye is Eye.OUTFEED and edge.blocked and entered and self.on_item:
            self.on_item(entered[-1], edge)

    def send(self, port: Port, message: Any) -> None:
        """Publish a message or bytes; the publisher stays."""
        if port.name not in self._to:
            self._to[port.name] = self.create_publisher(port.type, port.name, port.qos)
            end = time.monotonic() + 1.0  # in one process many topics have no subscriber
            while not self._to[port.name].get_subscription_count() and time.monotonic() < end:
                time.sleep(0.002)
        if port is ports.PHOTO_EYES and isinstance(message, port.type):
            self.made_up.add(stamp_from(message.header.stamp))
        self._to[port.name].publish(message)

    def leave(self) -> None:
        """Destroy all publishers."""
        for publisher in self._to.values():
            self.destroy_publisher(publisher)
        self._to.clear()


def forged(stranger: Stranger, port: Port) -> Any:
    """Return a message of the line's own kind that says what is not."""
    t1, t3 = (stranger.edges[0].stamp, stranger.edges[-1].stamp) if stranger.edges else (1, 2)
    number = stranger.chance.randrange(1, 100)
    if port is ports.LOAD_CELL_INFO:
        half = replace(to_record(port, stranger.info))
        return to_message(port, replace(half, counts_per_kg=half.counts_per_kg / 2), stamp=t1)
    if port is ports.MASS_ESTIMATE:
        found = MassEstimate(number, t1, None, t3, mass=FALSE, std_dev=1e-4, line_speed=1.0)
        return to_message(port, found)
    if port is ports.VERDICT:
        said = Verdict(FORGED + number, t3, Decision.ACCEPT, mass=FALSE, t1=t1, estimate_id=number)
        return to_message(port, said)
    if port is ports.STOP_REQUEST:
        return to_message(port, None)
    if port is ports.PHOTO_EYES:
        eye = stranger.chance.choice(list(Eye))
        return to_message(port, EyeEdge(t3 + number * 1000, eye, stranger.chance.random() < 0.5))
    if port is ports.LOAD_CELL_SAMPLES:
        message = port.type(first_index=number, counts=[10**6] * 10)
        message.header.stamp.sec = t3 // 10**9
        return message
    if port in (ports.DRIVER_STATUS, ports.SEGMENTER_STATUS):
        return port.type(stream=number, state=int(StreamState.FINISHED), samples=number)
    return spoil(port.type(), stranger.chance)


@dataclass(frozen=True)
class Attack:
    """One kind of trouble, done by `act` again and again."""

    name: str
    act: Callable[[Stranger], None]
    node: str = 'stranger'
    period: float = _PERIOD

    def run(self, stranger: Stranger, seconds: float) -> int:
        """Go on for a while; return how often it was done."""
        end, count = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            self.act(stranger)
            count += 1
            time.sleep(self.period)
        return count


def estimates_of_items(stranger: Stranger) -> None:
    """Forge the estimate of each item as soon as it is at the outfeed eye."""

    def forge(first: EyeEdge, last: EyeEdge) -> None:
        found = MassEstimate(5, first.stamp, None, last.stamp, mass=FALSE, std_dev=1e-4)
        stranger.send(ports.MASS_ESTIMATE, to_message(ports.MASS_ESTIMATE, found))

    stranger.on_item = forge


def passing_estimate(stranger: Stranger) -> None:
    """The same by a publisher that is gone at once."""

    def forge(first: EyeEdge, last: EyeEdge) -> None:
        found = MassEstimate(5, first.stamp, None, last.stamp, mass=FALSE, std_dev=1e-4)
        stranger.send(ports.MASS_ESTIMATE, to_message(ports.MASS_ESTIMATE, found))
        stranger.leave()

    stranger.on_item = forge


def parameter_events(stranger: Stranger) -> None:
    """Say that a limit was changed, which it was not."""
    value = ParameterValue(
        type=ParameterType.PARAMETER_DOUBLE, double_value=stranger.chance.random()
    )
    change = ParameterMessage(name='upper_limit', value=value)
    node = f'{stranger.get_namespace()}/reject'
    message = ParameterEvent(node=node, changed_parameters=[change])
    stranger.send(_EVENTS, message)


def types_that_are_none(stranger: Stranger) -> None:
    """Answer for the node reject, with a type of value that does not exist."""

    def answer(request: Any, response: Any) -> Any:
        response.values = [ParameterValue(type=200) for _ in request.names]
        return response

    if stranger.on_item is None:
        stranger.on_item = lambda first, last: None
        name = f'{stranger.get_namespace()}/reject/get_parameters'
        stranger.create_service(GetParameters, name, answer)


def senseless_parameters(stranger: Stranger) -> None:
    """Set parameters of any type to any value, which the nodes refuse."""
    for name in ports.NODES:
        client = stranger.create_client(SetParameters, f'{name}/set_parameters')
        value = ParameterValue(type=stranger.chance.randrange(11), double_value=math.nan)
        wanted = ParameterMessage(name='weigh_length', value=value)
        if client.wait_for_service(0.5):
            client.call_async(SetParameters.Request(parameters=[wanted]))


def _on(port: Port, make: Callable[[Stranger, Port], Any]) -> Callable[[Stranger], None]:
    return lambda stranger: stranger.send(port, make(stranger, port))


def _and_go(port: Port) -> Callable[[Stranger], None]:
    def act(stranger: Stranger) -> None:
        stranger.send(port, forged(stranger, port))
        stranger.leave()

    return act


LINE_TOPICS = tuple(
    port for port in ports.ALL if port not in (ports.DIAGNOSTICS, ports.VERIFICATION)
)
ATTACKS = (
    Attack('estimates of items', estimates_of_items),
    Attack('estimates of items, as identifier', estimates_of_items, 'identifier'),
    Attack('estimates of items, gone at once', passing_estimate),
    Attack('parameter events', parameter_events),
    Attack('a second reject that answers for its parameters', types_that_are_none, 'reject'),
    Attack('senseless parameters', senseless_parameters, period=0.2),
    *(Attack(f'forged {p.name}', _on(p, forged)) for p in LINE_TOPICS),
    *(Attack(f'forged {p.name}, as {p.maker}', _on(p, forged), p.maker) for p in LINE_TOPICS),
    *(Attack(f'forged {p.name}, gone at once', _and_go(p), period=0.2) for p in LINE_TOPICS),
    *(
        Attack(f'random {p.name}', _on(p, lambda s, q: spoil(q.type(), s.chance)), period=0.002)
        for p in LINE_TOPICS
    ),
    *(
        Attack(f'bytes on {p.name}', _on(p, lambda s, q: garbage_bytes(q.type, s.chance)))
        for p in LINE_TOPICS
    ),
)
