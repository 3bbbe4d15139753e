# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What all nodes of the line have in common: parameters, inputs and outputs, diagnostics."""

from collections.abc import Iterable, Sequence
import time
from typing import Generic

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.parameter import Parameter

from checkweigher_dsp.health.findings import Finding
from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.ros.diagnostics import Diagnostics
from checkweigher_dsp.ros.node_parameters import P, declare, ros_parameters
from checkweigher_dsp.ros.outputs import Output
from checkweigher_dsp.ros.port_node import PortNode
from checkweigher_dsp.ros.ports import Port

Overrides = dict[str, object]


class StageNode(PortNode, Generic[P]):
    """A node around one stage of the line, named ``parameters.node``.

    Its parameters are fixed once it runs if they are `read_only`; `overrides` win over values from
    the command line.
    """

    def __init__(
        self, parameters: type[P], *, read_only: bool = False, overrides: Overrides | None = None
    ) -> None:
        try:
            super().__init__(parameters.node, parameter_overrides=ros_parameters(overrides or {}))
        except InvalidParameterTypeException as error:  # of use_sim_time
            raise ParameterError(f'{parameters.node}: {error}') from None
        self.diagnostics = Diagnostics(self, self.diagnose)
        try:
            self.parameters = declare(self, parameters, read_only=read_only)
        except ParameterError:
            self.destroy_node()
            raise
        self.add_on_set_parameters_callback(self._check_parameters)

    def start(self) -> None:
        """Begin to tell how the node is."""
        self.diagnostics.start()

    def shut_down(self) -> None:
        """Leave in order before the process ends."""

    def last_words(self) -> Sequence[Output]:
        """Return the outputs whose messages have to arrive before the process ends."""
        return ()

    def on_parameters(self) -> None:
        """Use `self.parameters`, which have changed."""

    def diagnose(self, now: float) -> Iterable[Finding]:
        """Return how the aspects of this stage are at `now`, s of the monotonic clock."""
        return ()

    def received(self, port: Port) -> None:
        """Count a record that has come."""
        self.count(f'{port.name} received')

    def refuse(self, port: Port, error: Exception) -> None:
        """Log and count a record that the stage cannot use."""
        super().refuse(port, error)
        self.count(f'{port.name} refused')
        self.diagnostics.connections.refused(time.monotonic(), port.name, str(error))

    def fail(self, error: Exception, what: str = 'a callback failed') -> None:
        """Log and count an exception that ends a callback, and not the node."""
        self.count('exceptions')
        super().fail(error, what)

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
