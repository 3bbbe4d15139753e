# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Base class of stage nodes with a life cycle. A managed node stops the line until it is active."""

from collections.abc import Callable
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from checkweigher_core.parameters import ParameterError
from checkweigher_core.ros.node_parameters import P
from checkweigher_core.ros.port_node import locked
from checkweigher_core.ros.stage_node import StageNode

_SUCCESS = TransitionCallbackReturn.SUCCESS
_FAILURE, _ERROR = TransitionCallbackReturn.FAILURE, TransitionCallbackReturn.ERROR


class ManagedStageNode(LifecycleNodeMixin, StageNode[P]):
    """Stage node with the states of a ROS managed node.

    Unless the node is active, its outputs are safe, which means that they stop the line. A subclass
    overrides `configure`, `activate`, `deactivate` and `clean_up`, and calls `begin` at the end of
    its constructor. If one of the overridden methods raises an exception, the transition fails, and
    the exception is logged or, during `begin`, raised as `ParameterError`. If the parameter
    ``autostart`` is true, the node configures and activates itself. `state` is unconfigured,
    inactive, active or finalized.
    """

    def __init__(self, parameters: type[P], **options: Any) -> None:
        StageNode.__init__(self, parameters, **options)
        already, before = set(self.services), set(vars(self))
        LifecycleNodeMixin.__init__(self)
        self._life_cycle = set(vars(self)) - before
        self.state = 'unconfigured'
        self._failure = ''
        self._beginning = False
        for service in set(self.services) - already:
            service.callback = locked(service.callback)
            if service.srv_type is ChangeState:
                service.callback = self._refusing(service.callback)

    def configure(self) -> None:
        """Prepare the node for activation. Raises ValueError if the node cannot be prepared."""

    def activate(self) -> None:
        """Start the work of the node."""

    def deactivate(self) -> None:
        """Stop the work of the node and make the outputs safe."""

    def clean_up(self) -> None:
        """Release the resources that `configure` has acquired."""

    def begin(self) -> None:
        """Configure the node if ``autostart`` is true.

        If the node cannot be configured, it is destroyed, and `ParameterError` is raised.
        """
        if not getattr(self.parameters, 'autostart', True):
            return
        self._beginning = True  # do not log a failure, because ParameterError reports it
        configured = self.trigger_configure()
        self._beginning = False
        if configured != _SUCCESS:
            self.destroy_node()
            raise ParameterError(self._failure)

    def start(self) -> None:
        """Activate the node if ``autostart`` is true."""
        super().start()
        if getattr(self.parameters, 'autostart', True) and self.state == 'inactive':
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure the node. After a failure the node stays unconfigured."""
        return self._attempt('configure', self.configure, 'inactive', _FAILURE)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate the node. After a failure the node stays inactive."""
        return self._attempt('activate', self.activate, 'active', _FAILURE)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate the node. After a failure rclpy calls `on_error`."""
        return self._attempt('deactivate', self.deactivate, 'inactive', _ERROR)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release the resources of the node. After a failure rclpy calls `on_error`."""
        return self._attempt('clean up', self.clean_up, 'unconfigured', _ERROR)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the outputs safe before the node is finalized.

        After a failure rclpy calls `on_error`.
        """
        return self._attempt('shut down', self._release, 'finalized', _ERROR)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the outputs safe after the failure of a transition.

        The node is then unconfigured or, if the outputs cannot be made safe, finalized.
        """
        recovered = self._attempt('recover', self._release, 'unconfigured', _FAILURE)
        if recovered != _SUCCESS:
            self.state = 'finalized'
        return recovered

    def shut_down(self) -> None:
        """Make the outputs safe before the process ends."""
        if self.state in ('unconfigured', 'inactive', 'active'):
            self.trigger_shutdown()

    def destroy_node(self) -> None:
        """Destroy the node and its state machine.

        A remaining state machine would keep the node in the ROS graph.
        """
        super().destroy_node()
        # The attribute `_life_cycle` is missing if the constructor has failed.
        for name in vars(self).get('_life_cycle', ()):
            delattr(self, name)
        self._life_cycle = set()

    def _release(self) -> None:
        self.deactivate()
        self.clean_up()

    def _attempt(
        self, what: str, do: Callable[[], None], state: str, otherwise: TransitionCallbackReturn
    ) -> TransitionCallbackReturn:
        try:
            do()
        except Exception as error:
            self._failure = ' '.join(str(error).split())
            kind = '' if isinstance(error, ValueError) else f'{type(error).__name__}: '
            if not self._beginning:
                self.get_logger().error(f'could not {what}: {kind}{self._failure}')
            return otherwise
        self.state = state
        if not self._beginning:
            self.get_logger().info(state)
        return _SUCCESS

    def _refusing(self, change_state: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Return a service callback that refuses a transition if the present state forbids it.

        For a forbidden transition, the callback of rclpy raises an exception, which would end the
        executor.
        """

        def answer(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except RuntimeError:
                wanted = request.transition.label or request.transition.id
                self.warn(f'transition {wanted} is not possible: the node is {self.state}')
                response.success = False
                return response

        return answer
