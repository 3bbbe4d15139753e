# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Base class of the nodes of the line, with parameters, diagnostics, inputs and outputs."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
import time
import traceback
from typing import Any, Generic

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import InvalidParameterTypeException, ParameterNotDeclaredException
from rclpy.parameter import Parameter
from std_msgs.msg import Empty

from checkweigher_core.changes import PARAMETER
from checkweigher_core.health.findings import Finding
from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import NANOSECONDS
from checkweigher_core.ros.change_record import ChangeRecord
from checkweigher_core.ros.diagnostics import Diagnostics
from checkweigher_core.ros.graph.place import Place, participant_of
from checkweigher_core.ros.node_parameters import P, as_declared, declare, ros_parameters
from checkweigher_core.ros.outputs import Output
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.ports import ALIVE, Port

_ALIVE_PERIOD = round(0.2 * NANOSECONDS)
Overrides = dict[str, object]


class StageNode(PortNode, Generic[P]):
    """Node of the line. The name of the node is ``parameters.node``.

    If `read_only` is true, the parameters cannot change while the node runs. The parameter values
    `overrides` take precedence over values from the command line. If the lane has an audit log, the
    node writes a change of a parameter to this log before it makes the change.

    Raises
    ------
    ParameterError
        If a parameter is invalid, or if a node of this name runs already on this computer.
    """

    def __init__(
        self, parameters: type[P], *, read_only: bool = False, overrides: Overrides | None = None
    ) -> None:
        try:
            super().__init__(parameters.node, parameter_overrides=ros_parameters(overrides or {}))
        except InvalidParameterTypeException as error:  # raised if use_sim_time is not a bool
            raise ParameterError(f'{parameters.node}: {error}') from None
        self._place: Place | None = None
        try:
            self._place = Place(self.context.get_domain_id(), self.get_fully_qualified_name())
            self._place.sign(participant_of(self))
            self.change_record = ChangeRecord(self)
            self.diagnostics = Diagnostics(self, self._diagnose)
            self.parameters = declare(self, parameters, read_only=read_only)
        except ParameterError:
            self.destroy_node()
            raise
        self.add_on_set_parameters_callback(self._check_parameters)
        port = ALIVE.get(parameters.node)
        self._alive = self.output(port) if port else None

    def destroy_node(self) -> None:
        """Destroy the node, and release its place."""
        super().destroy_node()
        if self._place is not None:
            self._place.free()

    def start(self) -> None:
        """Start to publish diagnostics.

        If this stage has heartbeats, and the node reject runs in another process, also start to
        publish the heartbeats.
        """
        self.diagnostics.start()
        self.get_logger().info('ready')
        if self._alive is not None and not self._alive.takers:
            self._alive_timer = self.create_one_shot_timer(partial(self._send_alive, self._alive))
            self._send_alive(self._alive)

    def _send_alive(self, output: Output) -> None:
        """Send a heartbeat, which shows that no callback blocks the lock, and schedule the next."""
        output.send(Empty())
        self._alive_timer.set(time.monotonic_ns() + _ALIVE_PERIOD)

    def shut_down(self) -> None:
        """Prepare the node for the end of the process. A subclass overrides this method."""

    def final_outputs(self) -> Sequence[Output]:
        """Return the outputs whose messages must arrive before the process ends."""
        return ()

    def on_parameters(self) -> None:
        """Apply the changed `parameters`. A subclass overrides this method."""

    def diagnose(self, now: float) -> Iterable[Finding]:
        """Return the findings of this stage at time `now` in s on the monotonic clock."""
        return ()

    def _diagnose(self, now: float) -> Iterable[Finding]:
        self.change_record.look()
        return self.diagnose(now)

    def received(self, port: Port) -> None:
        """Count the arrival of a record, unless its port is excluded from bags."""
        if port.recorded:
            self.count(f'{port.name} received')

    def refuse(self, port: Port, error: Exception) -> None:
        """Log and count a record for which the conversion or the callback failed."""
        super().refuse(port, error)
        self.count(f'{port.name} refused')
        self.diagnostics.connections.refused(time.monotonic(), port.name, str(error))

    def fail(self, error: Exception, what: str = 'a callback failed') -> None:
        """Log and count an exception of a callback. The node continues."""
        self.count('exceptions')
        super().fail(error, what)

    def item_failed(self, item_id: int, error: Exception) -> None:
        """Log and count an exception that the stage raised for one item."""
        self.get_logger().error(''.join(traceback.format_exception(error)))
        self.fail(error, f'item {item_id}: the stage failed')

    def count(self, name: str) -> None:
        """Count an event. The diagnostics publish the counts."""
        self.diagnostics.count(name)

    def warn(self, text: str) -> None:
        """Log a warning, and publish it in the diagnostics."""
        self.diagnostics.warn(text)

    def create_service(  # type: ignore[no-untyped-def]
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **options: Any
    ):
        """Create a service. A service that sets parameters first writes to the audit log."""
        if srv_type in (SetParameters, SetParametersAtomically):
            callback = self._on_set_parameters
        return super().create_service(srv_type, srv_name, callback, **options)

    async def _on_set_parameters(self, request: Any, response: Any) -> Any:
        changes = [Parameter.from_parameter_msg(each) for each in request.parameters]
        if isinstance(response, SetParametersAtomically.Response):
            response.result = await self._set_recorded(changes)
        else:
            response.results = [await self._set_recorded([change]) for change in changes]
        return response

    async def _set_recorded(self, changes: list[Parameter]) -> SetParametersResult:
        """Write a change of parameters to the audit log, then set all parameters or none.

        If the entry cannot be written, no parameter is set. A value that a parameter already has is
        not a change, and is accepted even if the parameter is read-only.
        """
        changes = [change for change in map(self._as_declared, changes) if change is not None]
        if changes and self._may_set(changes):
            values = {change.name: change.value for change in changes}
            subject = self.get_fully_qualified_name()
            if reason := await self.change_record.write(PARAMETER, subject, values):
                self.warn(f'{", ".join(values)}: not changed: {reason}')
                return SetParametersResult(successful=False, reason=reason)
        try:
            return self.set_parameters_atomically(changes)
        except ParameterNotDeclaredException as error:
            return SetParametersResult(successful=False, reason=str(error))

    def _as_declared(self, given: Parameter) -> Parameter | None:
        """Return a change with a value of the declared type, or None if the value stays the same.

        The value stays the same if it equals both the parameter and the value in use. The parameter
        and the value in use may differ, for example while a limit of a product is in use.
        """
        if not self.has_parameter(given.name):
            return given
        declared = self.get_parameter(given.name)
        change = as_declared(declared, given)
        in_use = self.parameters.as_mapping().get(given.name, declared.value)
        (used,) = ros_parameters({given.name: in_use})
        value = change.get_parameter_value()
        same = value == declared.get_parameter_value() == used.get_parameter_value()
        return None if same else change

    def _may_set(self, changes: Sequence[Parameter]) -> bool:
        """Return whether the changes will be accepted.

        Changes that will be refused must not be written to the audit log.
        """
        names = [change.name for change in changes]
        known = all(map(self.has_parameter, names))
        if not known or any(each.read_only for each in self.describe_parameters(names)):
            return False
        try:
            self._changed(changes)
        except ParameterError:
            return False
        return True

    def _changed(self, changes: Sequence[Parameter]) -> P:
        """Return the parameter set as it will be after some changes.

        Raises `ParameterError` if a change is invalid.
        """
        values = self.parameters.as_mapping()
        changed = {change.name: change.value for change in changes if change.name in values}
        return type(self.parameters).from_mapping({**values, **changed})

    def _check_parameters(self, changes: Sequence[Parameter]) -> SetParametersResult:
        try:
            changed = self._changed(changes)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        if changed != self.parameters:
            self.parameters = changed
            self.on_parameters()
        return SetParametersResult(successful=True)
