"""Outputs and inputs of nodes: plain calls within a process, DDS to all others."""

from collections.abc import Callable, Sequence
import copy
import threading
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.ros.conversion import to_message, to_record
from checkweigher_dsp.ros.ports import Port, fits

# One lock for a process. Callbacks of stages run in the thread of the executor and, called from
# the source of the driver, in its thread, but never two at once.
LOCK = threading.RLock()
Callback = Callable[[Any], None]  # takes a record
# Endpoints have no event callbacks: each is one more entity that every wake of the executor
# collects. `Connections` finds a QoS that does not fit in the graph.


class Output:
    """Where a node sends the records of a port.

    The `takers` of the same process get each record by a plain call, all others from `publisher`.
    """

    def __init__(self, node: Node, port: Port) -> None:
        self.port = port
        self.qos = copy.copy(port.qos)
        self.takers: list[Input] = []
        events = PublisherEventCallbacks(use_default_callbacks=False)
        self.publisher = _endpoint(node.create_publisher, port, self.qos, event_callbacks=events)
        self.topic_name: str = self.publisher.topic_name
        self._latched = self.qos.durability != DurabilityPolicy.VOLATILE

    def send(self, record: Any, **header: Any) -> None:
        """Hand a record to the takers; `header` goes to the message alone."""
        with LOCK:
            if self._latched or self.publisher.get_subscription_count() > 0:
                is_message = self.port.record is None
                message = record if is_message else to_message(self.port, record, **header)
                self.publisher.publish(message)
            for taker in self.takers:
                taker.take(record)

    def connected(self) -> None:
        """Take that all takers of the process are known."""

    def count(self) -> int:
        """Return how many take the records, in this process and over DDS."""
        return len(self.takers) + int(self.publisher.get_subscription_count())


class Input:
    """Where a node takes the records of a port, from its `makers` or over DDS.

    The callback gets each record; what it raises is passed to ``node.refuse``. There is a
    `subscription`, with `qos`, only if there are no makers in the same process. A `needed` input
    without any maker is an error of the line.
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
        """Hand a record to the node."""
        self._node.received(self.port)
        try:
            self._callback(record)
        except Exception as error:
            self._node.refuse(self.port, error)

    def subscribe(self) -> None:
        """Take records over DDS."""
        events = SubscriptionEventCallbacks(use_default_callbacks=False)
        create, call = self._node.create_subscription, self._take_message
        self.subscription = _endpoint(create, self.port, call, self.qos, event_callbacks=events)

    def count(self) -> int:
        """Return how many make the records."""
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
    """Connect the inputs of the nodes of a process, before any of them begins to work.

    An input whose topic an output of these nodes makes, with a QoS that fits, is called by that
    output, and takes nothing over DDS. All other inputs subscribe. A node that is no `PortNode`
    has none.
    """
    members = [node for node in nodes if hasattr(node, 'inputs')]
    outputs = [output for node in members for output in node.outputs]
    for entry in (entry for node in members for entry in node.inputs):
        entry.makers = [
            output
            for output in outputs
            if output.topic_name == entry.topic_name
            and output.port.type is entry.port.type
            and fits(output.qos, entry.qos)
        ]
        for output in entry.makers:
            output.takers.append(entry)
        if not entry.makers:
            entry.subscribe()
    for output in outputs:
        output.connected()


def disconnect(node: Any) -> None:
    """Let go of the inputs and outputs of a node that is about to be destroyed."""
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
    """Return an endpoint whose depth, history and reliability may be set by parameters."""
    overriding = QoSOverridingOptions.with_default_policies()
    try:
        return create(port.type, port.name, *arguments, qos_overriding_options=overriding, **events)
    except (InvalidParameterTypeException, RuntimeError) as error:
        raise ParameterError(f'qos_overrides: {error}') from None
