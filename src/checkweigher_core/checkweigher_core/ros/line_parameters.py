# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Access to the parameters of other nodes of the lane, and detection of nodes that start."""

from collections.abc import Mapping
from typing import Any

from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from checkweigher_core.ros.graph.place import PARTICIPANT, full_name, is_held
from checkweigher_core.ros.node_parameters import ros_parameters

Values = dict[str, object]


class RefusedError(Exception):
    """Raised if a node refuses a parameter or does not answer. The message states the reason."""


class HalfSetError(RefusedError):
    """Raised if a node refuses a change or does not answer, and not all changes can be undone."""


class LineParametersClient:
    """Client of the parameter services of the nodes in the namespace of `node`.

    A callback in a single-threaded executor may await the coroutines of this class. The executor
    runs other callbacks while a coroutine waits for an answer. The client has its own callback
    group, because the awaiting callback blocks the group to which it belongs. `patience` is the
    longest wait for an answer in s.
    """

    def __init__(self, node: Node, patience: float) -> None:
        self._node = node
        self._patience = patience
        self._group = ReentrantCallbackGroup()
        self._clients: dict[str, AsyncParameterClient] = {}

    def ready(self, node: str) -> bool:
        """Return whether the parameter services of a node are available."""
        return bool(self._client(node).services_are_ready())

    async def get_all(self, node: str) -> Values:
        """Return the values of all parameters of a node by name.

        Raises `RefusedError` if the node does not answer.
        """
        listed = await self.answer(node, self._client(node).list_parameters())
        return await self.get(node, list(listed.result.names))

    async def get(self, node: str, names: list[str]) -> Values:
        """Return the values of the parameters `names` of a node by name.

        Raises `RefusedError` if the node lacks one of the parameters, or does not answer.
        """
        answer = await self.answer(node, self._client(node).get_parameters(names))
        if len(answer.values) != len(names):
            raise RefusedError(f'{node}: lacks one or more of {", ".join(names)}')
        return dict(zip(names, map(python_value, answer.values), strict=True))

    async def set(self, changes: Mapping[str, Values]) -> None:
        """Set parameters of several nodes, either all of them or none.

        If a node is missing, refuses a change or does not answer, all changes are undone, and
        `RefusedError` is raised. If a change cannot be undone, `HalfSetError` is raised.
        """
        for node in changes:
            if not self.ready(node):
                raise RefusedError(f'{node}: is not there')
        before = {node: await self.get(node, list(values)) for node, values in changes.items()}
        done: list[str] = []
        try:
            for node, values in changes.items():
                done.append(node)
                await self._set_one(node, values)
        except RefusedError as error:
            # Also restore the node that caused the error, because a node that did not answer may
            # have made its change.
            lost = [text for node in done if (text := await self._put_back(node, before[node]))]
            if lost:
                raise HalfSetError('; '.join([str(error), *lost])) from None
            raise

    async def _put_back(self, node: str, values: Values) -> str:
        """Restore the parameters of a node. Returns the reason of a failure, otherwise ''."""
        try:
            await self._set_one(node, values)
        except RefusedError as error:
            return f'the previous values could not be restored: {error}'
        return ''

    async def _set_one(self, node: str, values: Values) -> None:
        parameters = ros_parameters(values)
        answer = await self.answer(node, self._client(node).set_parameters_atomically(parameters))
        if not answer.result.successful:
            raise RefusedError(f'{node}: {answer.result.reason}')

    async def answer(self, node: str, future: Future) -> Any:
        """Return the result of `future`, which is the answer of a node to a request.

        Raises `RefusedError` if the node does not answer within `patience`.
        """
        answer = await in_time(self._node, self._group, future, self._patience)
        if answer is None:
            raise RefusedError(f'{node}: did not answer within {self._patience:g} s')
        return answer

    def _client(self, node: str) -> AsyncParameterClient:
        if node not in self._clients:
            self._clients[node] = AsyncParameterClient(self._node, node, callback_group=self._group)
        return self._clients[node]


class LineNodes:
    """Detector of nodes that start in the namespace of a given node.

    A node that starts creates a new publisher of parameter events, which the ROS graph shows.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: set[bytes] = set()

    def started(self) -> set[str]:
        """Return the names of the nodes that have started since the previous call.

        The first call returns all running nodes. A publisher is ignored while another process holds
        the place of its node, because it may be left over from a process that has ended.
        """
        found = set()
        domain = self._node.context.get_domain_id()
        for each in self._node.get_publishers_info_by_topic('/parameter_events'):
            identity = bytes(each.endpoint_gid)
            if identity in self._known or each.node_namespace != self._node.get_namespace():
                continue
            name = full_name(each)
            if is_held(domain, name, identity[:PARTICIPANT]) or not is_held(domain, name):
                self._known.add(identity)
                found.add(each.node_name)
        return found


async def in_time(node: Node, group: CallbackGroup, future: Future, patience: float) -> Any:
    """Return the result of a future, or None if it is not done within `patience` s.

    After `patience` s, a timer of `node` in the callback group `group` cancels the future.
    """
    timer = node.create_timer(patience, future.cancel, callback_group=group)
    try:
        return await future
    finally:
        node.destroy_timer(timer)


def python_value(value: Any) -> object:
    """Return a ParameterValue message as a Python value. Arrays become lists."""
    found = parameter_value_to_python(value)
    return list(found) if hasattr(found, '__iter__') and not isinstance(found, str) else found
