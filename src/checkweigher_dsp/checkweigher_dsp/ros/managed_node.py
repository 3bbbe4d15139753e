"""Nodes with a life cycle: what touches the machine is safe until it is told to work."""

from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher

from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.ros.stage_node import P, StageNode

_FAREWELL = Duration(seconds=1)  # for the last words of a process that is about to end


class ManagedStageNode(LifecycleNodeMixin, StageNode[P]):
    """A stage node with the states of a ROS managed node.

    A subclass says what to do in `configure`, `activate`, `deactivate` and `clean_up`, and calls
    `begin` when it is made. An exception in one of them is logged and lets the transition fail:
    rclpy would swallow it.

    Parameters
    ----------
    parameters : Parameters class
        With a field ``autostart``: whether nobody else starts the node.
    read_only, overrides
        As of `StageNode`.
    """

    def __init__(
        self,
        parameters: type[P],
        *,
        read_only: bool = False,
        overrides: dict[str, object] | None = None,
    ) -> None:
        StageNode.__init__(self, parameters, read_only=read_only, overrides=overrides)
        LifecycleNodeMixin.__init__(self)
        self._service_change_state.callback = self._guarded(self._service_change_state.callback)
        self._failure = ''
        self._beginning = False

    def configure(self) -> None:
        """Get ready to work; ValueError with one line if that cannot be done."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self) -> None:
        """Stop working and leave the outputs safe."""

    def clean_up(self) -> None:
        """Let go of what `configure` got hold of."""

    @property
    def state(self) -> str:
        """The state by its name: unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    def begin(self) -> None:
        """Configure now and activate as soon as the node spins, if it is to start by itself.

        Raises
        ------
        ParameterError
            If it cannot be configured; the node is destroyed then.
        """
        if not getattr(self.parameters, 'autostart', True):
            return
        self._beginning = True  # a failure is then the one line with which the process ends
        configured = self.trigger_configure()
        self._beginning = False
        if configured != TransitionCallbackReturn.SUCCESS:
            self.destroy_node()
            raise ParameterError(self._failure)
        self._start_timer = self.create_timer(0.0, self._activate_once)

    def _activate_once(self) -> None:
        self.destroy_timer(self._start_timer)
        if self.state == 'inactive':  # a lifecycle manager may have been faster
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; what fails leaves the node unconfigured."""
        return self._attempt('configure', self.configure, TransitionCallbackReturn.FAILURE)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate; what fails leaves the node inactive."""
        return self._attempt('activate', self.activate, TransitionCallbackReturn.FAILURE)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate; what fails goes on to `on_error`, for the node must not stay active."""
        return self._attempt('deactivate', self.deactivate, TransitionCallbackReturn.ERROR)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        return self._attempt('clean up', self.clean_up, TransitionCallbackReturn.ERROR)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave the outputs safe, whatever the state."""
        return self._attempt('shut down', self._release, TransitionCallbackReturn.ERROR)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave the outputs safe; the node is unconfigured then, or finalized if that fails."""
        return self._attempt('recover', self._release, TransitionCallbackReturn.FAILURE)

    def shut_down(self) -> bool:
        """Leave the outputs safe before the process ends, and wait until that has been heard."""
        if self.state in ('unconfigured', 'inactive', 'active'):
            self.trigger_shutdown()
        for publisher in self.last_words():
            publisher.wait_for_all_acked(_FAREWELL)
        return True

    def last_words(self) -> list[Publisher]:
        """Return the publishers whose messages have to arrive before the process ends."""
        return []

    def destroy_node(self) -> None:
        """Destroy the node with its state machine, which would keep its place in the graph."""
        super().destroy_node()
        if hasattr(self, '_state_machine'):  # not if a parameter was refused
            self._state_machine.destroy_when_not_in_use()

    def _release(self) -> None:
        self.deactivate()
        self.clean_up()

    def _attempt(
        self, what: str, do: Callable[[], None], otherwise: TransitionCallbackReturn
    ) -> TransitionCallbackReturn:
        try:
            do()
        except Exception as error:
            self._failure = ' '.join(str(error).split())
            kind = '' if isinstance(error, ValueError) else f'{type(error).__name__}: '
            if not self._beginning:
                self.get_logger().error(f'could not {what}: {kind}{self._failure}')
            return otherwise
        self.get_logger().debug(f'{what}: done')
        return TransitionCallbackReturn.SUCCESS

    def _guarded(self, change_state: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Return the service so that a transition which this state lacks is refused.

        rclpy raises out of spin, which would end the process.
        """

        def answer(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except _rclpy.RCLError:
                wanted = request.transition.label or request.transition.id
                self.warn(f'transition {wanted} is not possible: the node is {self.state}')
                response.success = False
                return response

        return answer
