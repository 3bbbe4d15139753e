# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Base class of nodes with inputs and outputs, whose callbacks hold the lock of the process."""

from collections.abc import Awaitable, Callable, Generator
from functools import partial
import inspect
import types
from typing import TYPE_CHECKING, Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from checkweigher_core.printable import one_line
from checkweigher_core.ros.one_shot_timer import OneShotTimer
from checkweigher_core.ros.outputs import LOCK, Callback, HeldOutput, Input, Output, disconnect
from checkweigher_core.ros.ports import Port

if TYPE_CHECKING:
    from checkweigher_core.ros.spinner import Spinner


class PortNode(Node):
    """Node with inputs and outputs.

    The callbacks of inputs, timers, services and actions hold the lock of the process. The node
    receives records after it was passed to `checkweigher_core.ros.outputs.connect`. `spinner` is
    the thread that runs the callbacks of the node, None until the node is added to a thread.
    """

    spinner: 'Spinner | None' = None

    def __init__(self, name: str, **options: Any) -> None:
        self.inputs: list[Input] = []
        self.outputs: list[Output] = []
        self._one_shot_timers: list[OneShotTimer] = []
        self._action_servers: list[ActionServer] = []
        super().__init__(name, **options)

    def start(self) -> None:
        """Start the work of the node. `Spinner.add` calls this after it has connected the node."""

    def output(self, port: Port) -> Output:
        """Return a new output for a port."""
        self.outputs.append(Output(self, port))
        return self.outputs[-1]

    def held_output(
        self, port: Port, answer: Port | None = None, before: Callback | None = None
    ) -> Output:
        """Return a new output that keeps its records until there is a consumer (`HeldOutput`)."""
        self.outputs.append(HeldOutput(self, port, answer, before))
        return self.outputs[-1]

    def subscribe(
        self, port: Port, callback: Callback, *, qos: QoSProfile | None = None, needed: bool = True
    ) -> Input:
        """Register a callback for the records of a port, and return its input."""
        entry = Input(self, port, callback, qos or port.stage_qos, needed=needed)
        self.inputs.append(entry)
        return entry

    def received(self, port: Port) -> None:
        """Notify the node that a record of a port has arrived. Here this has no effect."""

    def refuse(self, port: Port, error: Exception) -> None:
        """Log that the conversion or the callback failed for a record. The node continues."""
        self.warn(f'refused a message on {port.name}: {type(error).__name__}: {error}')

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], Any], *args: Any, **options: Any
    ) -> Timer:
        """Create a timer. An exception of the callback is logged, and the node continues."""
        guarded = self._guarded(locked(callback), 'a timer failed')
        return super().create_timer(timer_period_sec, guarded, *args, **options)

    def create_one_shot_timer(self, callback: Callable[[], object]) -> OneShotTimer:
        """Create a one-shot timer that does not wake the executor."""
        timer = OneShotTimer(callback, partial(self.fail, what='a timer failed'))
        self._one_shot_timers.append(timer)
        return timer

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        *args: Any,
        raw: bool = False,
        **options: Any,
    ) -> Subscription:
        """Create a subscription. Malformed messages and exceptions of the callback are logged.

        For a malformed message, rclpy would raise an exception in its executor, and would leave the
        callback group blocked. If `raw` is true, the callback gets the bytes of the message.
        """

        def convert(data: bytes) -> Any:
            return callback(data if raw else deserialize_message(data, msg_type))

        guarded = self._guarded(convert, f'refused a message on {topic}')
        return super().create_subscription(msg_type, topic, guarded, *args, raw=True, **options)

    def _guarded(
        self, callback: Callable[..., Any], what: str, otherwise: Callable[[], Any] = lambda: None
    ) -> Callable[..., Any]:
        """Return a callback that passes an exception to `fail`, and then returns `otherwise()`."""

        async def call(*args: Any) -> Any:
            try:
                result = callback(*args)
                return await result if inspect.iscoroutine(result) else result
            except Exception as error:
                with LOCK:
                    self.fail(error, what)
                return otherwise()

        return call

    def create_service(  # type: ignore[no-untyped-def]
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **options: Any
    ):
        """Create a service whose client gets a response even if the callback raises an exception.

        If the callback returns a text, the text becomes the `message` of the response, and
        `success` is set to true. If the callback raises ValueError, and the response has a
        `message`, the text of the exception becomes this `message`, `success` stays false, and the
        refusal is logged. After any other exception, the exception is logged, and the client gets
        an empty response. rclpy also creates its parameter services by this method, so that an
        exception for a parameter value of an unknown type is handled.
        """
        own = locked(callback)

        async def answer(request: Any, response: Any) -> Any:
            try:
                result = own(request, response)
                answered = await result if inspect.iscoroutine(result) else result
            except ValueError as error:
                if not hasattr(response, 'message'):
                    raise
                response.message = str(error)
                self.get_logger().info(f'{srv_name}: refused: {error}')
                return response
            if isinstance(answered, str):
                response.success, response.message, answered = True, answered, response
            # Serialise the response now, so that an exception for an invalid field is handled.
            serialize_message(answered)
            return answered

        guarded = self._guarded(answer, f'refused a call of {srv_name}', srv_type.Response)
        # Give each service a callback group of its own, because a malformed request blocks the
        # group.
        group = options.pop('callback_group', None) or MutuallyExclusiveCallbackGroup()
        return super().create_service(srv_type, srv_name, guarded, callback_group=group, **options)

    def warn_of(self, service: str, action: str) -> None:
        """Log that a service is deprecated, because an action replaces it."""
        self.get_logger().warning(f'the service {service} is deprecated: use the action {action}')

    def create_action(
        self,
        kind: Any,
        name: str,
        work: Callable[[Any, Any, Callable[..., None]], Awaitable[None]],
        cancel: Callable[[], object],
    ) -> None:
        """Create an action server.

        The coroutine function `work` is called with the goal, the result to fill in, and a function
        that publishes feedback with the values of its keyword arguments. If `work` refuses the goal
        or fails, it raises `ValueError` with the reason, which becomes the `message` of the result,
        and the goal is aborted. The function `cancel` is called when a client cancels the goal, and
        makes `work` end early. The goal ends as canceled, even if `work` raises `ValueError`.
        """
        own, end = locked(work), locked(cancel)

        async def execute(goal: ServerGoalHandle) -> Any:
            result, error = kind.Result(), ''

            def tell(**values: Any) -> None:
                goal.publish_feedback(kind.Feedback(**values))

            try:
                await own(goal.request, result, tell)
            except ValueError as found:
                result.message = error = str(found)
            if goal.is_cancel_requested:
                goal.canceled()
            elif error:
                goal.abort()
            else:
                goal.succeed()
            return result

        def on_cancel(goal: ServerGoalHandle) -> CancelResponse:
            end()
            return CancelResponse.ACCEPT

        # In a reentrant group, other callbacks run while a goal is executed, and a malformed
        # request does not block the group.
        group = ReentrantCallbackGroup()
        options = {'cancel_callback': on_cancel, 'callback_group': group}
        self._action_servers.append(ActionServer(self, kind, name, execute, **options))

    def fail(self, error: Exception, what: str = 'a callback failed') -> None:
        """Log an exception of a callback. The node continues."""
        self.warn(f'{what}: {type(error).__name__}: {error}')

    def warn(self, text: str) -> None:
        """Log a warning."""
        self.get_logger().warning(one_line(text))

    def destroy_node(self) -> None:
        """Disconnect the node from the other nodes of its process, and destroy it."""
        disconnect(self)
        with LOCK:
            for timer in self._one_shot_timers:
                timer.clear()
        for action in self._action_servers:
            action.destroy()
        super().destroy_node()


def locked(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return a callback that holds the lock of the process, except while it awaits a future."""
    if inspect.iscoroutinefunction(callback):

        async def in_steps(*args: Any) -> Any:
            return await _locked_steps(callback(*args))

        return in_steps

    def call(*args: Any) -> Any:
        with LOCK:
            return callback(*args)

    return call


@types.coroutine
def _locked_steps(coroutine: Any) -> Generator[Any, None, Any]:
    while True:
        with LOCK:
            try:
                waiting = coroutine.send(None)
            except StopIteration as end:
                return end.value
        yield waiting
