"""Connections of a node: who publishes and takes its topics, and whose QoS does not fit."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription

from checkweigher_dsp.health.findings import Concern, Finding, Level, RecentValues, conclude
from checkweigher_dsp.ros import ports

_PATIENCE = 5.0  # s, in which the nodes of a line find each other

# The node that has to publish a topic, and those that have to take it.
MAKERS = {port.name: port.maker for port in ports.ALL if port.maker in port.expected}
TAKERS = {
    port.name: ' and '.join(taker for taker in port.takers if taker in port.expected)
    for port in ports.ALL
}


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """One end of a topic: the subscription or publisher of this node."""

    name: str
    endpoint: Subscription | Publisher
    qos: QoSProfile
    partner: str  # the node at the other end, empty if it need not be there

    @property
    def is_input(self) -> bool:
        return isinstance(self.endpoint, Subscription)

    def count(self) -> int:
        """Return how many endpoints are connected to this one."""
        if isinstance(self.endpoint, Subscription):
            return int(self.endpoint.get_publisher_count())
        return int(self.endpoint.get_subscription_count())


class Connections:
    """Watch of the topics of a node.

    Parameters
    ----------
    node : Node
        Whose topics they are.
    began : float
        s on a clock that never steps back, when the node was started.
    warn : callable
        Takes a warning of a publisher or subscriber whose QoS does not fit.
    """

    def __init__(self, node: Node, began: float, warn: Callable[[str], None]) -> None:
        self._node = node
        self._began = began
        self._warn = warn
        self._ends: list[_End] = []
        self._refused = RecentValues()
        self._refusal = ''

    def input_events(self, name: str) -> Any:
        """Return None: rclpy's own callbacks log a QoS that does not fit."""
        return None

    def output_events(self, name: str) -> Any:
        """Return None: rclpy's own callbacks log a QoS that does not fit."""
        return None

    def add_input(
        self, name: str, subscription: Subscription, qos: QoSProfile, *, needed: bool
    ) -> None:
        """Watch a subscription; with `needed` there has to be a publisher."""
        self._ends.append(_End(name, subscription, qos, MAKERS.get(name, '') if needed else ''))

    def add_output(self, name: str, publisher: Publisher, qos: QoSProfile) -> None:
        """Watch a publisher."""
        self._ends.append(_End(name, publisher, qos, TAKERS.get(name, '')))

    def forget(self, endpoint: Subscription | Publisher) -> None:
        """Stop watching an endpoint that is about to be destroyed."""
        self._ends = [end for end in self._ends if end.endpoint is not endpoint]

    def refused(self, now: float, name: str, why: str) -> None:
        """Take that a message could not be used."""
        self._refused.add(now, 1.0)
        self._refusal = f'{name}: {why}'

    def lacks_input(self, name: str) -> bool:
        """Return whether a topic that this node subscribes to has no publisher."""
        return any(end.is_input and end.name == name and not end.count() for end in self._ends)

    def finding(self, now: float) -> Finding:
        """Return the aspect Connections; `now` in s on the clock of the beginning."""
        self._refused.forget(now)
        values: dict[str, float | str] = {}
        found: list[Concern] = []
        started = now - self._began > _PATIENCE
        for end in sorted(self._ends, key=lambda end: not end.is_input):
            count = end.count()
            if end.partner:
                values[f'{end.name} {"publishers" if end.is_input else "subscribers"}'] = count
            found += self._clashes(end, count)
            if started and end.partner and count == 0:
                level = Level.ERROR if end.is_input else Level.WARN
                missing = 'publisher' if end.is_input else 'subscriber'
                hint = f'check that {end.partner} runs, in this namespace and ROS_DOMAIN_ID'
                text = f'no {missing} of {end.endpoint.topic_name}'
                found.append(Concern(level, text, hint))
        values['messages refused in the last minute'] = len(self._refused)
        if len(self._refused):
            text = f'{len(self._refused)} messages refused in the last minute, {self._refusal}'
            hint = 'check which node publishes there and with which version of the messages'
            found.append(Concern(Level.WARN, text, hint))
        return conclude('Connections', 'all there', found, values)

    def _clashes(self, end: _End, matched: int) -> Iterator[Concern]:
        """Yield the endpoints at the other end whose QoS does not fit; DDS connects only others."""
        name, node = end.endpoint.topic_name, self._node
        known = node.count_publishers(name) if end.is_input else node.count_subscribers(name)
        if known <= matched:
            return
        if end.is_input:
            others = node.get_publishers_info_by_topic(name)
        else:
            others = node.get_subscriptions_info_by_topic(name)
        for other in others:
            pair = (other.qos_profile, end.qos) if end.is_input else (end.qos, other.qos_profile)
            compatibility, reason = qos_check_compatible(*pair)
            if compatibility != QoSCompatibility.ERROR:
                continue
            who = f'{other.node_namespace.rstrip("/")}/{other.node_name}'
            does = 'publishes' if end.is_input else 'subscribes to'
            why = reason.replace('ERROR: ', '').strip('; ').lower()
            text = f'{who} {does} {name} with a QoS that does not fit ({why})'
            level = Level.ERROR if end.partner and matched == 0 else Level.WARN
            yield Concern(level, text, f'change the QoS of {who} to that of docs/interfaces.md')


def has_matched_all(node: Node, *publishers: Publisher) -> bool:
    """Return whether publishers have matched every subscriber in the graph whose QoS fits."""
    return all(
        publisher.get_subscription_count()
        >= sum(
            ports.fits(publisher.qos_profile, other.qos_profile)
            for other in node.get_subscriptions_info_by_topic(publisher.topic_name)
        )
        for publisher in publishers
    )
