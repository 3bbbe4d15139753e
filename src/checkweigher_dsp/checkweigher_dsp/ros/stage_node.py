"""What all nodes of the line have in common: parameters, publishing, start and end."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import Field
import inspect
import math
import signal
import sys
import time
from types import FrameType
from typing import Any, Generic, TypeVar, cast

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from checkweigher_dsp.health.findings import Finding
from checkweigher_dsp.parameters import ParameterError, Parameters, describe
from checkweigher_dsp.ros.connections import MAKERS
from checkweigher_dsp.ros.delivery import DeliveringPublisher, Delivery, current, delivering
from checkweigher_dsp.ros.diagnostics import Diagnostics
from checkweigher_dsp.ros.executor import INTRA_PROCESS, ProcessParameters, make_executor
from checkweigher_dsp.ros.ports import Topic

_LARGEST_INTEGER = 2**63 - 1
_SWITCH_INTERVAL = 0.002  # s, after which Python lets another thread go on
_STOP_PERIOD = 0.2  # s, in which a signal ends the node
_FAREWELL = 0.1  # s, for what the end of one node is to the others of its process

P = TypeVar('P', bound=Parameters)


def descriptor(entry: 'Field[Any]', *, read_only: bool) -> ParameterDescriptor:
    """Return the ROS descriptor of a field made by `checkweigher_dsp.parameters.parameter`."""
    allowed = describe(entry)
    text = allowed.text + (f' [{allowed.unit}]' if allowed.unit else '')
    result = ParameterDescriptor(
        description=text,
        additional_constraints='one of ' + ', '.join(allowed.choices) if allowed.choices else '',
        read_only=read_only,
    )
    bounded = math.isfinite(allowed.minimum) or math.isfinite(allowed.maximum)
    if isinstance(entry.default, float) and bounded:
        result.floating_point_range = [
            FloatingPointRange(
                from_value=float(allowed.minimum), to_value=float(allowed.maximum), step=0.0
            )
        ]
    elif isinstance(entry.default, int) and not isinstance(entry.default, bool) and bounded:
        result.integer_range = [
            IntegerRange(
                from_value=int(max(allowed.minimum, -_LARGEST_INTEGER)),
                to_value=int(min(allowed.maximum, _LARGEST_INTEGER)),
                step=0,
            )
        ]
    return result


def declare(node: Node, parameters: type[P], prefix: str = '', *, read_only: bool) -> P:
    """Declare a parameter set to ROS and return it with the values that the node was given.

    Raises
    ------
    ParameterError
        If a value cannot be used.
    """
    values = {}
    for own_name, entry in parameters.entries().items():
        default = list(entry.default) if isinstance(entry.default, tuple) else entry.default
        name = prefix + own_name
        try:
            declared = node.declare_parameter(name, default, descriptor(entry, read_only=read_only))
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(f'{node.get_name()}.{name}: {error}') from None
        values[own_name] = declared.value
    return parameters.from_mapping(values)


class StageNode(Node, Generic[P]):
    """A node around one stage of the line.

    Parameters
    ----------
    parameters : Parameters class
        What the stage takes; ``parameters.node`` names the node.
    read_only : bool
        Whether the parameters are fixed once the node runs.
    overrides : mapping of str to object
        Values that win over those from the command line.
    """

    _health: Diagnostics | None = None  # Node itself makes publishers before there is any
    _delivery: Delivery | None = None

    def __init__(
        self,
        parameters: type[P],
        *,
        read_only: bool = False,
        overrides: dict[str, object] | None = None,
    ) -> None:
        try:
            super().__init__(
                parameters.node,
                parameter_overrides=[
                    Parameter(name, value=list(value) if isinstance(value, tuple) else value)
                    for name, value in (overrides or {}).items()
                ],
            )
        except InvalidParameterTypeException as error:  # of use_sim_time
            raise ParameterError(f'{parameters.node}: {error}') from None
        self._health = self.diagnostics = Diagnostics(self, self.diagnose)
        try:
            self.process = declare(self, ProcessParameters, read_only=True)
            self.parameters = declare(self, parameters, read_only=read_only)
        except ParameterError:
            self.destroy_node()
            raise
        if self.process.transport == INTRA_PROCESS:
            self._delivery = current()
        self.add_on_set_parameters_callback(self._check_parameters)
        self.diagnostics.start()

    def shut_down(self) -> bool:
        """Leave in order before the process ends; return whether others have to hear of it."""
        return False

    def on_parameters(self) -> None:
        """Use `self.parameters`, which have changed."""

    def diagnose(self, now: float) -> Iterable[Finding]:
        """Return how the aspects of this stage are at `now`, s of the monotonic clock."""
        return ()

    def create_publisher(
        self, msg_type: Any, topic: str, qos_profile: QoSProfile | int, **options: Any
    ) -> Publisher:
        """Create a publisher that tells of subscribers whose QoS does not fit."""
        if self._health is None or not isinstance(qos_profile, QoSProfile):
            return super().create_publisher(msg_type, topic, qos_profile, **options)
        connections = self._health.connections
        options.setdefault('event_callbacks', connections.output_events(topic))
        if self._delivery is not None:
            options.setdefault('publisher_class', DeliveringPublisher)
        publisher = super().create_publisher(msg_type, topic, qos_profile, **options)
        if isinstance(publisher, DeliveringPublisher) and self._delivery is not None:
            self._delivery.add_publisher(publisher)
        connections.add_output(topic, publisher, qos_profile)
        return publisher

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """Destroy a publisher."""
        if self._health is not None:
            self._health.connections.forget(publisher)
        if self._delivery is not None:
            self._delivery.forget(publisher)
        return bool(super().destroy_publisher(publisher))

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription."""
        if self._health is not None:
            self._health.connections.forget(subscription)
        if self._delivery is not None:
            self._delivery.forget(subscription)
        return bool(super().destroy_subscription(subscription))

    def subscribe(
        self, topic: Topic, callback: Callable[[Any], None], *, needed: bool | None = None
    ) -> Subscription:
        """Subscribe to a topic; a message that the callback cannot use is counted, not fatal.

        `needed` says whether somebody has to publish there; by default where the stages do.
        """

        def guarded(message: Any) -> None:
            self.count(f'{topic.name} received')
            try:
                callback(message)
            except Exception as error:
                self.warn(f'refused a message on {topic.name}: {type(error).__name__}: {error}')
                self.count(f'{topic.name} refused')
                self.diagnostics.connections.refused(time.monotonic(), topic.name, str(error))

        connections = self.diagnostics.connections
        events = connections.input_events(topic.name)
        ends = topic.type, topic.name, guarded, topic.stage_qos
        if self._delivery is not None:
            subscription = self._delivery.subscribe(self, *ends, events)
        else:
            subscription = self.create_subscription(*ends, event_callbacks=events)
        if needed is None:
            needed = topic.name in MAKERS
        connections.add_input(topic.name, subscription, topic.stage_qos, needed=needed)
        return subscription

    def create_service(  # type: ignore[no-untyped-def]
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **options: Any
    ):
        """Offer a service; a call that cannot be answered is refused, not fatal.

        Those of the parameters come by here too: in rclpy 7.1 an unknown type of a value raises.
        """
        if inspect.iscoroutinefunction(callback):
            return super().create_service(srv_type, srv_name, callback, **options)

        def guarded(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                self.warn(f'refused a call of {srv_name}: {type(error).__name__}: {error}')
                return srv_type.Response()

        return super().create_service(srv_type, srv_name, guarded, **options)

    def count(self, name: str) -> None:
        """Count something for the diagnostics."""
        self.diagnostics.count(name)

    def warn(self, text: str) -> None:
        """Log a warning, the same one at most once a second, and show it in the diagnostics."""
        self.diagnostics.warn(text)

    def _check_parameters(self, changes: Sequence[Parameter]) -> SetParametersResult:
        values = self.parameters.as_mapping()
        changed = {change.name: change.value for change in changes if change.name in values}
        if not changed:
            return SetParametersResult(successful=True)
        try:
            self.parameters = type(self.parameters).from_mapping({**values, **changed})
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.on_parameters()
        return SetParametersResult(successful=True)


def run(make_node: Callable[[], Node], arguments: Sequence[str] | None = None) -> None:
    """Run one node until it is interrupted; exit with 2 and one line if it cannot start."""
    run_all(cast(Callable[[], Sequence[Node]], lambda: [make_node()]), arguments)


def run_all(
    make_nodes: Callable[[], Sequence[Node]], arguments: Sequence[str] | None = None
) -> None:
    """Run several nodes in one process until SIGINT or SIGTERM; see `run`.

    On the way out the nodes shut down in the order opposite to that in which they were made.
    Signals stay with Python and only end the loop. Those of rclpy take the context away from
    whatever is under way, and KeyboardInterrupt comes up in the middle of a message.
    """
    # A source that has an edge to tell of must not wait for long while another thread makes
    # diagnostics, but of two threads that take turns too often both are late.
    sys.setswitchinterval(_SWITCH_INTERVAL)
    with delivering() as delivery:
        _run_all(make_nodes, arguments, delivery)


def _run_all(
    make_nodes: Callable[[], Sequence[Node]],
    arguments: Sequence[str] | None,
    delivery: Delivery,
) -> None:
    stopping = running = False

    def stop(*_: object) -> None:
        nonlocal stopping
        stopping = True
        if not running:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    nodes: Sequence[Node] = ()
    executor: SingleThreadedExecutor | None = None
    try:
        _initialise(arguments)
        nodes = make_nodes()
        names = {node.process.executor for node in nodes if isinstance(node, StageNode)}
        executor = make_executor(*names, delivery=delivery)
        for node in nodes:
            executor.add_node(node)
        # What rclpy does for the first thing that is logged takes 0.1 s and more: not in mid-line.
        inspect.getframeinfo(cast(FrameType, inspect.currentframe()))
        running = True
        while not stopping:
            executor.spin_once(timeout_sec=_STOP_PERIOD)
    except ParameterError as error:
        print(f'checkweigher: {" ".join(str(error).split())}', file=sys.stderr)
        raise SystemExit(2) from None
    except (Exception, KeyboardInterrupt):
        # C++ on the way up may have made another exception of the KeyboardInterrupt.
        if not stopping:
            raise
    finally:
        # Ctrl-C comes twice to a node of ros2 launch, from the terminal and from launch: the
        # second one must find nothing that it could break.
        running = True
        _shut_down(nodes, executor, delivery)
        if executor is not None:
            executor.shutdown()
        for node in reversed(nodes):
            node.destroy_node()
        rclpy.try_shutdown()
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _shut_down(
    nodes: Sequence[Node], executor: SingleThreadedExecutor | None, delivery: Delivery
) -> None:
    """Have each node leave in order, the last one first, while the others still work."""
    for node in reversed(nodes):
        if not isinstance(node, StageNode):
            continue
        try:
            with delivery.turn():
                told = node.shut_down()
            end = time.monotonic() + _FAREWELL
            while told and executor is not None and len(nodes) > 1 and time.monotonic() < end:
                executor.spin_once(timeout_sec=_FAREWELL)
        except Exception as error:  # the others have to be shut down all the same
            print(f'checkweigher: {type(error).__name__}: {error}', file=sys.stderr)


def _initialise(arguments: Sequence[str] | None) -> None:
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        # A parameter file that is not there or no YAML, a namespace that is none; rcl appends
        # places in its own source.
        raise ParameterError(str(error).split(', at /')[0]) from None
