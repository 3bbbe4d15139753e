"""A publisher that waits for its consumer."""

from collections import deque
import time
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from checkweigher_dsp.ros.ports import Topic

_POLL_PERIOD = 0.01  # s
_CONSUMER_PATIENCE = 5.0  # s, after which any subscriber is taken for the consumer
_SETTLE_TIME = 0.2  # s without a further subscriber, where any of them is the consumer
# More than this is not kept for a consumer that has not appeared yet.
_MAX_HELD = 10_000


class HeldPublisher:
    """Publish to a topic, keeping what comes before its consumer is there.

    At start-up the nodes of a line find each other in any order: without this, what the first one
    publishes before it has found the second would be lost, and an item without its verdict. Once
    there has been a consumer nothing is held any more: a stale window helps nobody.

    Parameters
    ----------
    node : Node
        Publishes.
    topic : Topic
        Where to.
    answer : Topic, optional
        What the consumer makes of it and publishes, under whatever name: a recorder that was there
        first does not pass for it, unless nobody else comes. Without, any subscriber is one.
    """

    def __init__(self, node: Node, topic: Topic, answer: Topic | None = None) -> None:
        self._publisher = node.create_publisher(topic.type, topic.name, topic.qos)
        self._answer = answer
        self._held: deque[Any] = deque(maxlen=_MAX_HELD)
        self._node = node
        self._timer = node.create_timer(_POLL_PERIOD, self._poll)
        self._open = False
        self._first_seen: float | None = None
        self._matched = (0, 0.0)  # how many, and since when

    @property
    def publisher(self) -> Publisher:
        """The publisher behind."""
        return self._publisher

    def publish(self, message: Any) -> None:
        """Publish a message now, or as soon as somebody listens."""
        if self._open:
            self._publisher.publish(message)
        else:
            self._held.append(message)

    def _poll(self) -> None:
        matched = self._publisher.get_subscription_count()
        if matched == 0:
            return
        now = time.monotonic()
        self._first_seen = self._first_seen or now
        if matched != self._matched[0]:
            self._matched = (matched, now)
        waited = now - self._first_seen
        if not self._has_consumer(matched) and waited < _CONSUMER_PATIENCE:
            return
        self._open = True
        self._node.destroy_timer(self._timer)
        while self._held:
            self._publisher.publish(self._held.popleft())

    def _has_consumer(self, matched: int) -> bool:
        readers = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
        # The graph may know of a reader that the publisher has yet to match.
        if matched < len(readers):
            return False
        if self._answer is None:
            # A node that was started again finds one reader after the other.
            return time.monotonic() - self._matched[1] > _SETTLE_TIME
        kind = f'{self._answer.type.__module__.split(".")[0]}/msg/{self._answer.type.__name__}'
        return any(
            kind in self._types_published_by(reader.node_name, reader.node_namespace)
            for reader in readers
        )

    def _types_published_by(self, name: str, namespace: str) -> set[str]:
        try:
            published = self._node.get_publisher_names_and_types_by_node(name, namespace)
        except RuntimeError:  # the graph knows its endpoints, but not yet the node
            return set()
        return {kind for _, kinds in published for kind in kinds}
