# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of other nodes of the lane, which are set together or not at all."""

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
    """A node refused a parameter or did not answer; the message has the node and the reason."""


class HalfSetError(RefusedError):
    """A node refused a change, and the change of another node could not be undone."""


class LineParametersClient:
    """Client of the parameter services of the nodes of a lane.

    Its coroutines are for callbacks of a single-threaded executor, which serves other callbacks
    while one waits for an answer. The client has its own callback group, because the waiting
    callback blocks its own group. The other nodes are in the namespace of `node`. `patience` is the
    longest wait for an answer, s.
    """

    def __init__(self, node: Node, patience: float) -> None:
        self._node = node
        self._patience = patience
        self._group = ReentrantCallbackGroup()
        self._clients: dict[str, AsyncParameterClient] = {}

    def ready(self, node: str) -> bool:
        """Return whether the services of a node are available."""
        return bool(self._client(node).services_are_ready())

    async def get_all(self, node: str) -> Values:
        """Return all parameters of a node; `RefusedError` if it does not answer."""
        listed = await self.answer(node, self._client(node).list_parameters())
        return await self.get(node, list(listed.result.names))

    async def get(self, node: str, names: list[str]) -> Values:
        """Return some parameters of a node; `RefusedError` if it does not have them all."""
        answer = await self.answer(node, self._client(node).get_parameters(names))
        if len(answer.values) != len(names):
            raise RefusedError(f'{node}: does not have all of {", ".join(names)}')
        return dict(zip(names, map(python_value, answer.values), strict=True))

    async def set(self, changes: Mapping[str, Values]) -> None:
        """Set parameters of several nodes, all or none.

        If a node refuses, all changes are undone, and `RefusedError` is raised, or `HalfSetError`
        if they cannot be undone.
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
            # Includes the last node, because a node that does not answer may have made its change.
            lost = [text for node in done if (text := await self._put_back(node, before[node]))]
            if lost:
                raise HalfSetError('; '.join([str(error), *lost])) from None
            raise

    async def _put_back(self, node: str, values: Values) -> str:
        """Restore the parameters of a node; return why that failed, empty if it did not."""
        try:
            await self._set_one(node, values)
        except RefusedError as error:
            return f'and could not be put back: {error}'
        return ''

    async def _set_one(self, node: str, values: Values) -> None:
        parameters = ros_parameters(values)
        answer = await self.answer(node, self._client(node).set_parameters_atomically(parameters))
        if not answer.result.successful:
            raise RefusedError(f'{node}: {answer.result.reason}')

    async def answer(self, node: str, future: Future) -> Any:
        """Return the answer of a node; `RefusedError` if it does not come in time."""
        answer = await in_time(self._node, self._group, future, self._patience)
        if answer is None:
            raise RefusedError(f'{node}: has not answered for {self._patience:g} s')
        return answer

    def _client(self, node: str) -> AsyncParameterClient:
        if node not in self._clients:
            self._clients[node] = AsyncParameterClient(self._node, node, callback_group=self._group)
        return self._clients[node]


class LineNodes:
    """Watch for starts of the nodes in the namespace of a node.

    Each start of a node makes a new publisher of its parameter events. The graph shows it even if
    the messages of the start were lost.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: set[bytes] = set()

    def started(self) -> set[str]:
        """Return the nodes that have been started since the last call."""
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
    """Return the result of a future, None if there is none within `patience`, s."""
    timer = node.create_timer(patience, future.cancel, callback_group=group)
    try:
        return await future
    finally:
        node.destroy_timer(timer)


def python_value(value: Any) -> object:
    """Return a ParameterValue message as a Python value, arrays as lists."""
    found = parameter_value_to_python(value)
    return list(found) if hasattr(found, '__iter__') and not isinstance(found, str) else found
