"""Whether a node is connected: who publishes and takes its topics, and whose QoS does not fit."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.qos import qos_policy_name_from_kind as policy_name
from rclpy.subscription import Subscription

from checkweigher_dsp.health.findings import Concern, Finding, Level, RecentValues, conclude
from checkweigher_dsp.ros import ports

_PATIENCE = 5.0  # s, in which the nodes of a line find each other

# Who publishes what a stage cannot do without, and who has to take what it publishes.
MAKERS = {
    ports.LOAD_CELL_INFO.name: 'driver',
    ports.LOAD_CELL_SAMPLES.name: 'driver',
    ports.PHOTO_EYES.name: 'driver',
    ports.WEIGH_WINDOW.name: 'segmenter',
    ports.DENOISED_WINDOW.name: 'denoise',
    ports.MASS_ESTIMATE.name: 'identifier',
    ports.VERDICT.name: 'reject',
}
TAKERS = {
    ports.LOAD_CELL_SAMPLES.name: 'segmenter',
    ports.PHOTO_EYES.name: 'segmenter and reject',
    ports.WEIGH_WINDOW.name: 'denoise',
    ports.DENOISED_WINDOW.name: 'identifier',
    ports.MASS_ESTIMATE.name: 'reject',
}


@dataclass(slots=True, eq=False)
class _End:
    """One end of a topic: the subscription or publisher of this node."""

    endpoint: Subscription | Publisher
    qos: QoSProfile
    partner: str  # the node at the other end, empty if it need not be there
    clashed: bool = False  # whether somebody with another QoS was there


class Connections:
    """Watch the topics of a node.

    Parameters
    ----------
    node : Node
        Whose topics they are.
    began : float
        s on a clock that never steps back, when the node was started.
    warn : callable
        Tells of somebody whose QoS does not fit.
    """

    def __init__(self, node: Node, began: float, warn: Callable[[str], None]) -> None:
        self._node = node
        self._began = began
        self._warn = warn
        self._inputs: dict[str, _End] = {}
        self._outputs: dict[str, _End] = {}
        self._refused = RecentValues()
        self._refusal = ''

    def input_events(self, name: str) -> SubscriptionEventCallbacks:
        """Return what a subscription of a topic has to be made with."""
        return SubscriptionEventCallbacks(
            incompatible_qos=lambda event: self._on_clash(self._inputs, name, event, 'publishes')
        )

    def output_events(self, name: str) -> PublisherEventCallbacks:
        """Return what a publisher of a topic has to be made with."""
        return PublisherEventCallbacks(
            incompatible_qos=lambda event: self._on_clash(self._outputs, name, event, 'subscribes')
        )

    def add_input(
        self, name: str, subscription: Subscription, qos: QoSProfile, *, needed: bool
    ) -> None:
        """Watch a subscription; with `needed` somebody has to publish."""
        partner = MAKERS.get(name, '') if needed else ''
        self._inputs[name] = _End(subscription, qos, partner)

    def add_output(self, name: str, publisher: Publisher, qos: QoSProfile) -> None:
        """Watch a publisher."""
        self._outputs[name] = _End(publisher, qos, TAKERS.get(name, ''))

    def forget(self, endpoint: Subscription | Publisher) -> None:
        """Watch an end no longer: it is about to be destroyed."""
        for ends in (self._inputs, self._outputs):
            for name in [name for name, end in list(ends.items()) if end.endpoint is endpoint]:
                del ends[name]

    def refused(self, now: float, name: str, why: str) -> None:
        """Take that a message could not be used."""
        self._refused.add(now, 1.0)
        self._refusal = f'{name}: {why}'

    def lacks_input(self, name: str) -> bool:
        """Tell whether nobody publishes a topic that this node subscribes to."""
        end = self._inputs.get(name)
        return end is not None and end.endpoint.get_publisher_count() == 0

    def finding(self, now: float) -> Finding:
        """Return the aspect Connections; `now` in s on the clock of the beginning."""
        self._refused.forget(now)
        values: dict[str, float | str] = {}
        found: list[Concern] = []
        started = now - self._began > _PATIENCE
        for name, end in list(self._inputs.items()):  # a node may be destroyed meanwhile
            count = end.endpoint.get_publisher_count()
            if end.partner:
                values[f'{name} publishers'] = count
            found += self._clashes(end, count)
            if started and end.partner and count == 0:
                text = f'nobody publishes {end.endpoint.topic_name}'
                found.append(Concern(Level.ERROR, text, _whom_to_look_for(end.partner)))
        for name, end in list(self._outputs.items()):
            count = end.endpoint.get_subscription_count()
            if end.partner:
                values[f'{name} subscribers'] = count
            found += self._clashes(end, count)
            if started and end.partner and count == 0:
                text = f'nobody takes {end.endpoint.topic_name}'
                found.append(Concern(Level.WARN, text, _whom_to_look_for(end.partner)))
        values['messages refused in the last minute'] = len(self._refused)
        if len(self._refused):
            text = f'{len(self._refused)} messages refused in the last minute, {self._refusal}'
            hint = 'check who publishes there and with which version of the messages'
            found.append(Concern(Level.WARN, text, hint))
        return conclude('Connections', 'all there', found, values)

    def _on_clash(self, ends: dict[str, _End], name: str, event: Any, does: str) -> None:
        if name in ends:
            ends[name].clashed = True
        policy = policy_name(event.last_policy_kind)
        self._warn(f'somebody {does} {name} with a {policy} that does not fit: never connects')

    def _clashes(self, end: _End, matched: int) -> Iterator[Concern]:
        """Yield who offers or asks for another QoS; DDS tells when one comes, not that it went."""
        if not end.clashed:
            return
        is_input = isinstance(end.endpoint, Subscription)
        name = end.endpoint.topic_name
        look = (
            self._node.get_publishers_info_by_topic
            if is_input
            else self._node.get_subscriptions_info_by_topic
        )
        end.clashed = False
        for other in look(name):
            pair = (other.qos_profile, end.qos) if is_input else (end.qos, other.qos_profile)
            compatibility, reason = qos_check_compatible(*pair)
            if compatibility != QoSCompatibility.ERROR:
                continue
            end.clashed = True
            who = f'{other.node_namespace.rstrip("/")}/{other.node_name}'
            does = 'publishes' if is_input else 'subscribes to'
            why = reason.replace('ERROR: ', '').strip('; ').lower()
            text = f'{who} {does} {name} with a QoS that does not fit ({why})'
            level = Level.ERROR if end.partner and matched == 0 else Level.WARN
            yield Concern(level, text, f'change the QoS of {who} to that of docs/interfaces.md')


def has_matched_all(node: Node, *publishers: Publisher) -> bool:
    """Tell whether publishers have matched every subscriber that the graph knows and they suit."""
    return all(
        publisher.get_subscription_count()
        >= sum(
            ports.fits(publisher.qos_profile, other.qos_profile)
            for other in node.get_subscriptions_info_by_topic(publisher.topic_name)
        )
        for publisher in publishers
    )


def _whom_to_look_for(partner: str) -> str:
    return f'check that {partner} runs, in this namespace and ROS_DOMAIN_ID'
