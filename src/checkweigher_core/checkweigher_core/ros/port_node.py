# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node with inputs and outputs. Only one callback of a process runs at a time."""

from collections.abc import Callable, Generator
from functools import partial
import inspect
import types
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
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
    """A node whose callbacks all hold the lock of the process.

    It receives records once `checkweigher_core.ros.outputs.connect` has connected it. `spinner`
    serves it, and possibly others.
    """

    spinner: 'Spinner | None' = None

    def __init__(self, name: str, **options: Any) -> None:
        self.inputs: list[Input] = []
        self.outputs: list[Output] = []
        self._one_shot_timers: list[OneShotTimer] = []
        super().__init__(name, **options)

    def start(self) -> None:
        """Begin to work, once the node is connected and served."""

    def output(self, port: Port) -> Output:
        """Return an output of a port."""
        self.outputs.append(Output(self, port))
        return self.outputs[-1]

    def held_output(self, port: Port, answer: Port | None = None) -> Output:
        """Return an output that waits for its consumer; see `HeldOutput`."""
        self.outputs.append(HeldOutput(self, port, answer))
        return self.outputs[-1]

    def subscribe(
        self, port: Port, callback: Callback, *, qos: QoSProfile | None = None, needed: bool = True
    ) -> Input:
        """Register a callback for the records of a port; see `Input`."""
        entry = Input(self, port, callback, qos or port.stage_qos, needed=needed)
        self.inputs.append(entry)
        return entry

    def received(self, port: Port) -> None:
        """Process the arrival of a record."""

    def refuse(self, port: Port, error: Exception) -> None:
        """Log a record that the callback cannot use; this is not fatal."""
        self.warn(f'refused a message on {port.name}: {type(error).__name__}: {error}')

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], Any], *args: Any, **options: Any
    ) -> Timer:
        """Create a timer; an exception of its callback is logged and not fatal."""
        guarded = self._guarded(locked(callback), 'a timer failed')
        return super().create_timer(timer_period_sec, guarded, *args, **options)

    def create_one_shot_timer(self, callback: Callable[[], object]) -> OneShotTimer:
        """Create a timer that does not wake the executor; see `OneShotTimer`."""
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
        """Create a subscription; a malformed message or an exception is logged and not fatal.

        For a malformed message, rclpy would raise an exception out of its executor, and leave the
        callback group blocked. With `raw` the callback gets the bytes.
        """

        def convert(data: bytes) -> Any:
            return callback(data if raw else deserialize_message(data, msg_type))

        guarded = self._guarded(convert, f'refused a message on {topic}')
        return super().create_subscription(msg_type, topic, guarded, *args, raw=True, **options)

    def _guarded(
        self,
        callback: Callable[..., Any],
        what: str,
        otherwise: Callable[[], Any] = lambda: None,
    ) -> Callable[..., Any]:
        """Return a callback that passes an exception to `fail`, and then returns `otherwise()`."""

        async def call(*args: Any) -> Any:
            try:
                result = callback(*args)
                return await result if inspect.iscoroutine(result) else result
            except Exception as error:
                self.fail(error, what)
                return otherwise()

        return call

    def create_service(  # type: ignore[no-untyped-def]
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **options: Any
    ):
        """Create a service; the answer to a call that fails is an empty response.

        rclpy creates its parameter services here, too, and they raise for a value of an unknown
        type.
        """
        own = locked(callback)

        async def answer(request: Any, response: Any) -> Any:
            result = own(request, response)
            answered = await result if inspect.iscoroutine(result) else result
            serialize_message(answered)  # raises for a text that no message can hold
            return answered

        guarded = self._guarded(answer, f'refused a call of {srv_name}', srv_type.Response)
        # A malformed request leaves its callback group blocked, so each service has its own.
        group = options.pop('callback_group', None) or MutuallyExclusiveCallbackGroup()
        return super().create_service(srv_type, srv_name, guarded, callback_group=group, **options)

    def fail(self, error: Exception, what: str = 'a callback failed') -> None:
        """Log an exception that ends a callback, but not the node."""
        self.warn(f'{what}: {type(error).__name__}: {error}')

    def warn(self, text: str) -> None:
        """Log a warning."""
        self.get_logger().warning(one_line(text))

    def destroy_node(self) -> None:
        """Disconnect the node from the others of its process, and destroy it."""
        disconnect(self)
        with LOCK:
            for timer in self._one_shot_timers:
                timer.clear()
        super().destroy_node()


def locked(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return a callback that holds the lock of the process; a coroutine holds it in each step."""
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
