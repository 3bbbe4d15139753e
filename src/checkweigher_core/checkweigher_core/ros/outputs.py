# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Outputs and inputs of nodes, connected by function calls within a process, otherwise by DDS."""

from collections import deque
from collections.abc import Callable, Sequence
import copy
import threading
import time
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from checkweigher_core.parameters import ParameterError
from checkweigher_core.ros.conversion import to_message, to_record
from checkweigher_core.ros.ports import Port, fits

# Lock of the process. Callbacks run in the thread of the executor, in the thread of the one-shot
# timers, and in the thread of the driver that reads the samples. The lock ensures that only one
# callback runs at a time.
LOCK = threading.RLock()
Callback = Callable[[Any], None]  # function that processes a record
_POLL_PERIOD = 0.02  # time in s between two searches for a consumer
_CONSUMER_PATIENCE = 5.0  # time in s after which any subscriber counts as a consumer
_SETTLE_TIME = 0.2  # time in s without a new subscriber after which the kept records are sent
_MAX_HELD = 10_000  # largest number of records that are kept for a consumer


class Output:
    """Output of a node for the records of a port.

    The inputs `takers` in the same process get each record by a function call. All other
    subscribers get the records from `publisher`.
    """

    def __init__(self, node: Any, port: Port) -> None:
        self.port = port
        self.qos = copy.copy(port.qos)
        self.takers: list[Input] = []
        # Create the endpoint without event callbacks, which would slow down each wake of the
        # executor. The class `Connections` detects incompatible QoS instead.
        events = PublisherEventCallbacks(use_default_callbacks=False)
        self.publisher = _endpoint(node.create_publisher, port, self.qos, event_callbacks=events)
        self.topic_name: str = self.publisher.topic_name
        self._latched = self.qos.durability != DurabilityPolicy.VOLATILE

    def send(self, record: Any, **header: Any) -> None:
        """Send a record to all takers and subscribers. `header` is passed to `to_message`."""
        with LOCK:
            if self._latched or self.publisher.get_subscription_count() > 0:
                is_message = self.port.record is None
                self.publisher.publish(
                    record if is_message else to_message(self.port, record, **header)
                )
            for taker in self.takers:
                taker.take(record)

    def connected(self) -> None:
        """Notify the output that `connect` has added all its takers. Here this has no effect."""

    def count(self) -> int:
        """Return the number of subscribers, in this process and over DDS."""
        return len(self.takers) + int(self.publisher.get_subscription_count())


class HeldOutput(Output):
    """Output that keeps its records until a consumer has been discovered.

    The nodes of a line discover each other in any order. A record that is sent too early would be
    lost, and its item would get no verdict. After a consumer has been discovered, records are sent
    immediately. An input in the same process is a consumer. A subscriber in another process is a
    consumer if its node also publishes messages of the type of the port `answer`, which a recorder
    does not publish. If `answer` is None, any subscriber counts as a consumer as soon as no further
    subscriber has appeared for 0.2 s. Any subscriber also counts as a consumer if no consumer has
    been discovered within 5 s after the first subscriber. At most 10,000 records are kept; if there
    are more, the oldest are lost. The function `before` is called with each record just before the
    record is sent.
    """

    def __init__(
        self, node: Node, port: Port, answer: Port | None = None, before: Callback | None = None
    ) -> None:
        super().__init__(node, port)
        self._node = node
        self._answer = answer
        self._before = before
        self._held: deque[Any] | None = deque(maxlen=_MAX_HELD)
        self._first_seen: float | None = None
        self._matched = (0, 0.0)  # number of subscribers, and time in s of its last change

    def send(self, record: Any, **header: Any) -> None:
        """Send a record now, or as soon as a consumer has been discovered.

        `header` is used only for a record that is sent now.
        """
        with LOCK:
            if self._held is not None:
                self._held.append(record)
                return
            if self._before:
                self._before(record)
            super().send(record, **header)

    def connected(self) -> None:
        """Send the kept records if there is a taker, otherwise search for a consumer by a timer."""
        if self.takers:
            self._release()
        else:
            self._timer = self._node.create_timer(_POLL_PERIOD, self._look_for_consumer)

    def _release(self) -> None:
        held, self._held = self._held or (), None
        for record in held:
            self.send(record)

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
        # Wait until all subscribers in the ROS graph are connected.
        if matched < len(readers):
            return False
        if self._answer is None:
            # Wait until no further subscriber appears, because a restarted node discovers the
            # subscribers one by one.
            return time.monotonic() - self._matched[1] > _SETTLE_TIME
        return any(
            self._answer.message_type
            in self._types_published_by(reader.node_name, reader.node_namespace)
            for reader in readers
        )

    def _types_published_by(self, name: str, namespace: str) -> set[str]:
        try:
            published = self._node.get_publisher_names_and_types_by_node(name, namespace)
        except RuntimeError:  # the ROS graph contains endpoints of the node, but not yet the node
            return set()
        return {kind for _, kinds in published for kind in kinds}


class Input:
    """Input of a node for the records of a port.

    The callback gets each record of the outputs `makers` in the same process. If `makers` is empty,
    the input has a `subscription` with the QoS profile `qos`. An exception of the callback is
    passed to ``node.refuse``. If a `needed` input has no publisher, the diagnostics show an error.
    """

    def __init__(
        self, node: Any, port: Port, callback: Callback, qos: QoSProfile, *, needed: bool
    ) -> None:
        self.port = port
        self.needed = needed
        self.qos = copy.copy(qos)
        self.topic_name = str(node.resolve_topic_name(port.name))
        self.makers: list[Output] = []
        self.subscription: Subscription | None = None
        self._node = node
        self._callback = callback

    def take(self, record: Any) -> None:
        """Call the callback with a record, and pass its exception to ``node.refuse``."""
        self._node.received(self.port)
        try:
            self._callback(record)
        except Exception as error:
            self._node.refuse(self.port, error)

    def subscribe(self) -> None:
        """Create the subscription."""
        events = SubscriptionEventCallbacks(use_default_callbacks=False)
        create, call = self._node.create_subscription, self._take_message
        self.subscription = _endpoint(create, self.port, call, self.qos, event_callbacks=events)

    def count(self) -> int:
        """Return the number of publishers of this input, in the same process or over DDS."""
        if self.subscription is None:
            return len(self.makers)
        return int(self.subscription.get_publisher_count())

    def _take_message(self, message: Any) -> None:
        with LOCK:
            try:
                record = message if self.port.record is None else to_record(self.port, message)
            except Exception as error:
                self._node.refuse(self.port, error)
            else:
                self.take(record)


def connect(nodes: Sequence[Any]) -> None:
    """Connect the inputs and outputs of the nodes of a process, before the nodes start.

    An output passes its records by function calls to each input of the nodes that has the same
    topic and a compatible QoS. An input to which no output of the nodes passes records gets a
    subscription over DDS.
    """
    outputs = [output for node in nodes for output in getattr(node, 'outputs', ())]
    for entry in [entry for node in nodes for entry in getattr(node, 'inputs', ())]:
        entry.makers = [output for output in outputs if _feeds(output, entry)]
        for output in entry.makers:
            output.takers.append(entry)
        if not entry.makers:
            entry.subscribe()
    for output in outputs:
        output.connected()


def _feeds(output: Output, entry: Input) -> bool:
    same = output.topic_name == entry.topic_name and output.port.type is entry.port.type
    return same and fits(output.qos, entry.qos)


def disconnect(node: Any) -> None:
    """Disconnect a node from the other nodes of its process."""
    with LOCK:
        for entry in node.inputs:
            for output in entry.makers:
                output.takers.remove(entry)
            entry.makers = []
        for output in node.outputs:
            for entry in output.takers:
                entry.makers.remove(output)
            output.takers = []


def _endpoint(create: Callable[..., Any], port: Port, *arguments: Any, **events: Any) -> Any:
    """Return a new publisher or subscription of a port.

    Parameters of the node may override the depth, the history and the reliability. Raises
    `ParameterError` if an overriding parameter is invalid.
    """
    overriding = QoSOverridingOptions.with_default_policies()
    try:
        return create(port.type, port.name, *arguments, qos_overriding_options=overriding, **events)
    except (InvalidParameterTypeException, RuntimeError) as error:
        raise ParameterError(f'qos_overrides: {error}') from None
