# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Talk to the nodes of a graph, and play a bag through its stages."""

import queue
import time
from typing import Any

from action_msgs.msg import GoalStatus
from checkweigher_msgs.msg import StreamStatus
from rclpy.action import ActionClient
from rclpy.node import Node
from running import BAGS, PATIENCE, wait_for

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.health.findings import Finding
from checkweigher_core.ros import ports
from checkweigher_core.ros.ports import Port
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.pipeline.line import Weighing


def call(node: Node, kind: Any, name: str, /, **values: object) -> Any:
    """Call a service from a node that spins, and return the answer."""
    client = node.create_client(kind, name)
    wait_for(client.service_is_ready)
    answer = client.call_async(kind.Request(**values))
    wait_for(answer.done)
    return answer.result()


class Goal:
    """Goal of an action, sent by a spinning node, with its feedback so far."""

    def __init__(self, node: Node, kind: Any, name: str, /, **values: object) -> None:
        self._node, self._client = node, ActionClient(node, kind, name)
        wait_for(self._client.server_is_ready)
        self.feedback: list[Any] = []
        # The executor sends the goal, so that the answer cannot arrive before the goal is known.
        self._end = node.executor.create_task(self._send, kind.Goal(**values))

    async def _send(self, goal: Any) -> Any:
        def note(message: Any) -> None:
            self.feedback.append(message.feedback)

        self._handle = await self._client.send_goal_async(goal, note)
        return await self._handle.get_result_async()

    @property
    def done(self) -> bool:
        return bool(self._end.done())

    @property
    def status(self) -> int:
        wait_for(self._end.done)
        return int(self._end.result().status)

    @property
    def success(self) -> bool:
        return self.status == GoalStatus.STATUS_SUCCEEDED

    @property
    def result(self) -> Any:
        wait_for(self._end.done)
        return self._end.result().result

    @property
    def message(self) -> str:
        return str(self.result.message)

    def cancel(self) -> bool:
        """Request the cancellation of the goal, and return whether it was cancelled."""
        wait_for(lambda: hasattr(self, '_handle'))
        self._node.executor.create_task(self._handle.cancel_goal_async)
        return self.status == GoalStatus.STATUS_CANCELED


def aspect(node: Any, name: str) -> Finding:
    """Return the finding on an aspect, as the diagnostics of a node show it."""
    return next(each for each in node.diagnose(time.monotonic()) if each.aspect == name)


def publish(node: Node, topic: Port, message: Any) -> None:
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    wait_for(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(message)
    assert publisher.wait_for_all_acked()
    node.destroy_publisher(publisher)


def heard(node: Node, topic: Port, *, latched: bool = False) -> 'queue.SimpleQueue[Any]':
    """Return where a topic's messages come, each with its time of arrival in ns."""
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
    node.create_subscription(
        topic.type,
        topic.name,
        lambda message: messages.put((time.monotonic_ns(), message)),
        topic.qos if latched else topic.stage_qos,
    )
    return messages


def make_stages() -> list[Node]:
    """Make all stages, for bags that come faster than their time."""
    return [
        make({'deadlines': False} if name == 'reject' else None)
        for name, make in STAGE_NODES.items()
    ]


def play(spinner: Spinner, listener: ResultListener) -> list[Weighing]:
    """Play a bag through the stages that are there and return what became of its items."""
    while not listener.weighings.empty():
        listener.weighings.get()
    said = heard(listener, ports.SEGMENTER_STATUS)
    driver = DriverNode({'source': 'bag', 'bag.path': str(BAGS / 'paper_90'), 'rate': 0.0})
    spinner.add(driver)
    for state in (StreamStatus.RUNNING, StreamStatus.FINISHED):
        while said.get(timeout=PATIENCE)[1].state != state:
            pass
    spinner.remove(driver)
    weighings = []
    while len(weighings) < 25:
        weighing = listener.weighings.get(timeout=PATIENCE)
        if weighing.estimate.weighed:
            weighings.append(weighing)
    return weighings
