"""The parameters of other nodes of the lane: read, set together or not at all."""

from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

Values = dict[str, object]


class RefusedError(Exception):
    """A node did not take a parameter, or did not answer; the message says which and why."""


class NoAnswerError(RefusedError):
    """A node did not answer."""


class LineParametersClient:
    """Talk to the parameter services of the nodes of a lane.

    Coroutines for callbacks of one single-threaded executor: while one waits for an answer, the
    executor serves the others. That needs a callback group of its own, for the group of the
    callback that waits is taken until it ends.

    Parameters
    ----------
    node : Node
        In whose namespace the others are.
    patience : float
        s, how long to wait for an answer.
    """

    def __init__(self, node: Node, patience: float) -> None:
        self._node = node
        self._patience = patience
        self._group = ReentrantCallbackGroup()
        self._clients: dict[tuple[type, str], Client] = {}

    def ready(self, node: str) -> bool:
        """Tell whether the services of a node are there."""
        return all(
            self._client(kind, node).service_is_ready()
            for kind in (GetParameters, ListParameters, SetParametersAtomically)
        )

    async def get_all(self, node: str) -> Values:
        """Return all parameters of a node; `RefusedError` if it does not answer."""
        listed = await self._call(ListParameters, node, ListParameters.Request())
        return await self.get(node, list(listed.result.names))

    async def get(self, node: str, names: list[str]) -> Values:
        """Return some parameters of a node; `RefusedError` if it does not have them all."""
        answer = await self._call(GetParameters, node, GetParameters.Request(names=names))
        if len(answer.values) != len(names):
            raise RefusedError(f'{node}: does not have all of {", ".join(names)}')
        pairs = zip(names, answer.values, strict=True)
        return {name: python_value(value) for name, value in pairs}

    async def set(self, changes: Mapping[str, Values]) -> None:
        """Set parameters of several nodes, all or none.

        Raises
        ------
        RefusedError
            If a node refuses; what others had taken is then put back.
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
            # One that refuses has changed nothing; one that does not answer may yet have.
            if not isinstance(error, NoAnswerError):
                done.pop()
            lost = await self._put_back({node: before[node] for node in done})
            raise RefusedError('; '.join([str(error), *lost])) from None

    async def _put_back(self, values: Mapping[str, Values]) -> list[str]:
        lost = []
        for node in values:
            try:
                await self._set_one(node, values[node])
            except RefusedError as error:
                lost.append(f'and could not be put back: {error}')
        return lost

    async def _set_one(self, node: str, values: Values) -> None:
        request = SetParametersAtomically.Request(
            parameters=[parameter_message(name, value) for name, value in values.items()]
        )
        answer = await self._call(SetParametersAtomically, node, request)
        if not answer.result.successful:
            raise RefusedError(f'{node}: {answer.result.reason}')

    async def _call(self, kind: Any, node: str, request: Any) -> Any:
        client = self._client(kind, node)
        future = client.call_async(request)
        timer = self._node.create_timer(self._patience, future.cancel, callback_group=self._group)
        try:
            answer = await future
        finally:
            self._node.destroy_timer(timer)
        if answer is None:
            client.remove_pending_request(future)
            raise NoAnswerError(f'{node}: has not answered for {self._patience:g} s')
        return answer

    def _client(self, kind: Any, node: str) -> Client:
        if (kind, node) not in self._clients:
            services = {
                GetParameters: 'get_parameters',
                ListParameters: 'list_parameters',
                SetParametersAtomically: 'set_parameters_atomically',
            }
            self._clients[kind, node] = self._node.create_client(
                kind, f'{node}/{services[kind]}', callback_group=self._group
            )
        return self._clients[kind, node]


class LineNodes:
    """Notice which nodes of the lane have been started.

    Each node has a publisher of its parameter events, and each start another one: that is seen in
    the graph however the messages of the start itself were lost.

    Parameters
    ----------
    node : Node
        In whose namespace the others are.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: set[bytes] = set()

    def started(self) -> set[str]:
        """Return the nodes that were not there when this was asked last."""
        found = set()
        for each in self._node.get_publishers_info_by_topic('/parameter_events'):
            identity = bytes(each.endpoint_gid)
            if identity not in self._known and each.node_namespace == self._node.get_namespace():
                self._known.add(identity)
                found.add(each.node_name)
        return found


def python_value(value: Any) -> object:
    """Return a ParameterValue message as a Python value, arrays as lists."""
    found = parameter_value_to_python(value)
    return list(found) if hasattr(found, '__iter__') and not isinstance(found, str) else found


def parameter_message(name: str, value: object) -> ParameterMessage:
    """Return a Parameter message of a Python value."""
    plain = list(value) if isinstance(value, tuple) else value
    return Parameter(name, value=plain).to_parameter_msg()
