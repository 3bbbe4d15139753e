"""An output that waits for its consumer."""

from collections import deque
import time
from typing import Any

from rclpy.node import Node

from checkweigher_dsp.ros.outputs import LOCK, Output
from checkweigher_dsp.ros.ports import Port

_POLL_PERIOD = 0.02  # s
_CONSUMER_PATIENCE = 5.0  # s, after which any subscriber is taken for the consumer
_SETTLE_TIME = 0.2  # s without a further subscriber, where any of them is the consumer
# More than this is not kept for a consumer that has not appeared yet.
_MAX_HELD = 10_000


class HeldOutput(Output):
    """Send records, and keep those that come before their consumer is there.

    At start-up the nodes of a line find each other in any order: without this, what the first one
    sends before it has found the second would be lost, and an item without its verdict. Once
    there has been a consumer nothing is held any more: a stale window helps no one. A taker in
    the same process is a consumer from the start. Elsewhere it is a node that publishes records of
    the port `answer`, under any name: a recorder that was there first does not pass for it, unless
    it remains alone. Without `answer` any subscriber is the consumer.
    """

    def __init__(self, node: Node, port: Port, answer: Port | None = None) -> None:
        super().__init__(node, port)
        self._node = node
        self._answer = answer
        self._held: deque[Any] | None = deque(maxlen=_MAX_HELD)
        self._first_seen: float | None = None
        self._matched = (0, 0.0)  # how many, and since when

    def send(self, record: Any, **header: Any) -> None:
        """Send a record now, or as soon as its consumer is there."""
        with LOCK:
            if self._held is None:
                super().send(record, **header)
            else:
                self._held.append(record)

    def connected(self) -> None:
        """Send from now on to the takers of the process, or look for a consumer elsewhere."""
        if self.takers:
            self._release()
        else:
            self._timer = self._node.create_timer(_POLL_PERIOD, self._look_for_consumer)

    def _release(self) -> None:
        held, self._held = self._held or (), None
        for record in held:
            super().send(record)

    def _look_for_consumer(self) -> None:
        matched = self.publisher.get_subscription_count()
        if matched == 0:
            return
        now = time.monotonic()
        self._first_seen = self._first_seen or now
        if matched != self._matched[0]:
            self._matched = (matched, now)
        if self._has_consumer(matched) or now - self._first_seen > _CONSUMER_PATIENCE:
            self._node.destroy_timer(self._timer)
            self._release()

    def _has_consumer(self, matched: int) -> bool:
        readers = self._node.get_subscriptions_info_by_topic(self.topic_name)
        # The graph may know of a reader that the publisher has yet to match.
        if matched < len(readers):
            return False
        if self._answer is None:
            # A node that was started again finds one reader after the other.
            return time.monotonic() - self._matched[1] > _SETTLE_TIME
        return any(
            self._answer.message_type
            in self._types_published_by(reader.node_name, reader.node_namespace)
            for reader in readers
        )

    def _types_published_by(self, name: str, namespace: str) -> set[str]:
        try:
            published = self._node.get_publisher_names_and_types_by_node(name, namespace)
        except RuntimeError:  # the graph knows its endpoints, but not yet the node
            return set()
        return {kind for _, kinds in published for kind in kinds}
