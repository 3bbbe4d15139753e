# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calls of the services and actions of a lane, from threads that do not spin an executor."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import json
import queue
import threading
from typing import Any

from action_msgs.msg import GoalStatus
from checkweigher_msgs.srv import RecordChange
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import spinning
from checkweigher_core.ros import ports
from checkweigher_core.ros.services import TECHNICIAN

# Maximum time in s to wait until a service or an action is found and, by default, for an answer.
PATIENCE = 5.0
_LOOK_PERIOD = 1.0  # period in s of the check whether the node of an action still runs
_END_PATIENCE = 30.0  # maximum time in s until a cancelled goal has ended


@contextmanager
def technician(namespace: str) -> Iterator[Node]:
    """Yield a node for calls of the services and actions of a lane.

    The node is in the namespace of the lane, and spins until the context ends. With ROS security,
    the node has the rights to calibrate, train and verify the machine, and to write to the audit
    log.
    """
    with spinning(namespace, TECHNICIAN) as spinner:
        node = rclpy.create_node(TECHNICIAN)
        spinner.add(node)
        yield node


def call(node: Any, kind: Any, name: str, /, patience: float = PATIENCE, **values: Any) -> Any:
    """Call a service with the fields of a request, and return its answer.

    `patience` is the maximum time in s to wait for the service, and then for the answer. Raises
    `UserError` if there is no service or no answer in time, or if the service refuses the call.
    """
    client = node.create_client(kind, name)
    try:
        if not client.wait_for_service(patience):
            raise UserError(f'there is no service {client.srv_name}; is the line running?')
        future = client.call_async(kind.Request(**values))
        answer = answer_of(future, client.srv_name, patience)
    finally:
        node.destroy_client(client)
    if not answer.success:
        raise UserError(answer.message)
    return answer


def write_to_log(node: Node, kind: str, subject: str, value: object, who: str) -> None:
    """Write an entry to the audit log of the running line. Raises `UserError` as `call` does."""
    text = json.dumps(value)
    name = ports.RECORD_CHANGE
    call(node, RecordChange, name, kind=kind, subject=subject, new_value=text, who=who)


def answer_of(future: Any, name: str, patience: float) -> Any:
    """Return the result of a future, or raise `UserError` if it is not done after `patience` s.

    `name` is the name of the service or action in the error message. If the future ends with an
    exception, this exception is raised.
    """
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    if not done.wait(patience):
        raise UserError(f'no answer from {name} within {patience:g} s')
    return future.result()


def perform(
    node: Node, kind: Any, name: str, follow: Callable[[Any], None], /, **values: Any
) -> Any:
    """Perform an action with the fields of a goal, and return its result.

    `follow` is called in this thread with each feedback. If `follow` raises an exception, or the
    user interrupts the command, the goal is cancelled. The exception is raised again when the goal
    has ended, or at the latest after `_END_PATIENCE` s. Raises `UserError` if no node offers the
    action, if its node ends before the goal, or if the goal does not succeed.
    """
    goal = _Goal(node, kind, name, values)
    try:
        return goal.result(follow)
    except BaseException:
        goal.cancel()
        raise


class _Goal:
    """Goal that the executor of a node sends to the server of an action."""

    def __init__(self, node: Node, kind: Any, name: str, values: dict[str, Any]) -> None:
        assert node.executor is not None
        self._executor = node.executor
        self._name = node.resolve_service_name(name)
        self._client = ActionClient(node, kind, name)
        if not self._client.wait_for_server(PATIENCE):
            raise UserError(
                f'there is no action {self._name}; start the line with a folder (run --folder DIR)'
            )
        self._feedback: queue.SimpleQueue[Any] = queue.SimpleQueue()  # ends with None
        self._handle = Future()
        # The executor sends the goal, so that rclpy registers it before an answer can arrive.
        self._end = self._executor.create_task(self._run, kind.Goal(**values))
        self._end.add_done_callback(lambda _: self._feedback.put(None))

    async def _run(self, goal: Any) -> Any:
        sent = self._client.send_goal_async(goal, lambda each: self._feedback.put(each.feedback))
        self._handle.set_result(await sent)
        return await self._handle.result().get_result_async()

    def result(self, follow: Callable[[Any], None]) -> Any:
        """Call `follow` with each feedback until the goal ends, and return its result.

        Raises `UserError` if the goal does not succeed, or if the node of the action ends before
        the goal.
        """
        while (feedback := self._next()) is not None:
            follow(feedback)
        ended = self._end.result()
        if ended.status != GoalStatus.STATUS_SUCCEEDED:
            raise UserError(ended.result.message or f'{self._name}: the goal was cancelled')
        return ended.result

    def cancel(self) -> None:
        """Cancel the goal if it still runs, and wait for at most `_END_PATIENCE` s for its end."""
        if self._end.done() or not self._client.server_is_ready():
            return
        self._executor.create_task(self._cancel)
        with suppress(UserError):
            answer_of(self._end, self._name, _END_PATIENCE)

    async def _cancel(self) -> None:
        await (await self._handle).cancel_goal_async()

    def _next(self) -> Any:
        """Return the next feedback, or None at the end of the goal.

        Raises `UserError` if the node of the action ends before the goal.
        """
        while True:
            with suppress(queue.Empty):
                return self._feedback.get(timeout=_LOOK_PERIOD)
            if not self._client.server_is_ready():
                raise UserError(f'{self._name}: its node has ended')
