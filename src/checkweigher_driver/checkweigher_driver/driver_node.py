# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Driver node, which publishes samples and photo-eye edges and switches the rejector."""

from collections.abc import Sequence
from functools import partial
import time
from typing import Any

from std_srvs.srv import Trigger

from checkweigher_core.health.findings import Finding
from checkweigher_core.health.host_clock import HostClock
from checkweigher_core.parameters import ParameterError, Parameters
from checkweigher_core.recording import Event
from checkweigher_core.records import (
    ExternalReject,
    EyeEdge,
    Reference,
    StopRequest,
    StreamState,
    Verdict,
)
from checkweigher_core.records.reasons import StopReason
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.managed_node import ManagedStageNode
from checkweigher_core.ros.node_parameters import P, declare
from checkweigher_core.ros.outputs import Output
from checkweigher_core.ros.port_node import locked
from checkweigher_core.ros.running import run
from checkweigher_driver import devices
from checkweigher_driver.calibration.services import CalibrationServices
from checkweigher_driver.calibration.session import CalibrationParameters
from checkweigher_driver.devices import DriverParameters
from checkweigher_driver.health import DriverWatch
from checkweigher_driver.line_io.machine_inputs import InputEvent
from checkweigher_driver.source_stream import SourceStream
from checkweigher_driver.sources import Source

_LOOK_PERIOD = 0.2  # period in s of the check for faults of the machine


class DriverNode(ManagedStageNode[DriverParameters]):
    """Node that publishes samples, edges and machine inputs, and switches the outputs.

    A separate thread reads the source. Each activation begins a new `stream` of samples.
    """

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(DriverParameters, read_only=True, overrides=overrides)
        self._source: Source | None = None

        def read(kind: type[P]) -> P:
            return declare(self, kind, f'{kind.node}.', read_only=True)

        try:
            self._make_source = devices.source_maker(
                self.parameters.source, self.parameters.eyes, read
            )
            self._outputs = devices.make_outputs(self.parameters.outputs, read)
            self._inputs = devices.make_inputs(self.parameters.inputs, read)
            calibration = read(CalibrationParameters)
            self._operation = self._declare_operation()
        except ParameterError:
            self.destroy_node()
            raise
        if self._inputs.exist:
            self._conditions = self.output(ports.MACHINE_CONDITIONS)
            # An `Output` cannot be used, because a reject node in the same process would then not
            # receive the messages of other publishers on the topic `external_reject`.
            port = ports.EXTERNAL_REJECT
            self._external_rejects = self.create_publisher(port.type, port.name, port.qos)
        self._watch = DriverWatch(self.parameters.source)
        self._host_clock = HostClock()
        self.stream = SourceStream(
            self, self.parameters, self._watch, self._note, lambda: self._outputs.ready
        )
        self.subscribe(ports.SEGMENTER_STATUS, self.stream.on_segmenter_status)
        self.subscribe(ports.ITEMS, self._outputs.take, needed=False)
        self.subscribe(ports.VERDICT, self._on_verdict, needed=False)
        self.subscribe(ports.STOP_REQUEST, self._on_stop_request)
        if self._outputs.exist:
            self.subscribe(ports.PERMISSION, self._outputs.take)
            self.create_service(Trigger, ports.RESET_OUTPUTS, self._reset_outputs)
        self._calibration = CalibrationServices(
            self, calibration, self.parameters.source, self._restart_stream
        )
        self._look_timer = self.create_timer(_LOOK_PERIOD, self._check_machine, autostart=False)
        self.begin()

    def configure(self) -> None:
        """Open the source, the outputs and the inputs.

        Raises `ParameterError` if the calibration file is invalid, if the source cannot be opened,
        or if the file with the state of the belt cannot be used.
        """
        try:
            self._calibration.read()  # report an invalid calibration before a device is opened
            self._source = self._make_source()
        except ParameterError:
            raise
        except ValueError as error:
            raise ParameterError(f'driver.source: {error}') from None
        if self._operation is not None:
            self._source.operate(self._operation)
        self._outputs.open(lambda: bool(self._machine_trouble()))
        self._inputs.open(locked(self._publish_input))

    def _declare_operation(self) -> Parameters | None:
        """Declare and return the operator's settings of a simulated machine.

        Returns None if the source is not a simulated machine.
        """
        kind = devices.source_class(self.parameters.source).operation
        if kind is None:
            return None
        found = declare(self, kind, f'{kind.node}.', read_only=False)
        self.add_post_set_parameters_callback(self._operate)
        return found

    def _operate(self, changes: Sequence[Any]) -> None:
        """Apply the settings that the operator has changed.

        rclpy has checked the ranges of the settings.
        """
        assert self._operation is not None
        prefix = f'{self._operation.node}.'
        values = {
            change.name.removeprefix(prefix): change.value
            for change in changes
            if change.name.startswith(prefix)
        }
        self._operation = self._operation.from_mapping(self._operation.as_mapping() | values)
        if self._source is not None:
            self._source.operate(self._operation)

    def activate(self) -> None:
        """Begin a new stream with the values of the calibration file, and activate the outputs.

        A source that the last deactivation has closed is opened again. Raises `ParameterError` if
        the calibration file is invalid, or if the source cannot be opened.
        """
        if self._source is None:  # the last deactivation has closed a source whose reads block
            self.configure()
        assert self._source is not None
        load_cell = self._source.load_cell = self._calibration.apply(self._source.load_cell)
        self._calibration.begin(load_cell)
        self.diagnostics.set_hardware(load_cell)
        self._watch.begin(load_cell, time.monotonic())
        self._outputs.activate()
        if self._outputs.exist or self._inputs.exist or not self._source.paced:
            self._look_timer.reset()
        self.stream.begin(self._source)

    def deactivate(self) -> None:
        """Make the outputs safe, and end the calibration session and the stream.

        Items on the belt get the decision FAULT, and are reported as missed, which stops the line
        until a person has looked for them.
        """
        self._outputs.safe()
        self._calibration.end()
        self._look_timer.cancel()
        if self._stop_reading():
            self.stream.report(StreamState.FINISHED, 'the driver was deactivated')
        self._watch.stop()

    def clean_up(self) -> None:
        """Close the source, the outputs and the inputs."""
        self._close_source()
        self._outputs.close()
        self._inputs.close()

    def _close_source(self) -> None:
        if self._source is not None:
            self._source.close()
            self._source = None

    def final_outputs(self) -> list[Output]:
        """Return the output of the driver status, which reports the end of the stream."""
        return [self.stream.status]

    def destroy_node(self) -> None:
        """End the stream, close the devices, and destroy the node."""
        if hasattr(self, 'stream'):
            self._stop_reading()
            self.clean_up()
        super().destroy_node()

    def _stop_reading(self) -> bool:
        """End the stream; return whether it was still running.

        A source whose reads block is also closed, because its last read would otherwise not end.
        """
        blocks = self._source is not None and not self._source.paced
        return self.stream.end(self._close_source if blocks else None)

    def _on_verdict(self, verdict: Verdict) -> None:
        self._outputs.take(verdict)  # called first, because the rejector has to act in time
        self.stream.on_verdict()

    def _on_stop_request(self, request: StopRequest | None) -> None:
        self._outputs.take(request)
        self.stream.reject_ready = request is None or request.reason is not StopReason.NOT_READY

    def _note(self, event: Event) -> None:
        self._watch.add(time.monotonic(), event)
        if not isinstance(event, Reference):
            self._calibration.add(event)
        if isinstance(event, EyeEdge):
            self._outputs.take(event)

    def _publish_input(self, event: InputEvent) -> None:
        if isinstance(event, ExternalReject):
            self._external_rejects.publish(to_message(ports.EXTERNAL_REJECT, event))
        else:
            self._conditions.send(event)

    def _machine_trouble(self) -> str:
        """Return the present fault of the stream, the source or the inputs, or '' without a fault.

        The result is also '' while no source is open. Any thread may call this.
        """
        source = self._source
        if source is None:
            return ''
        return self.stream.failure or source.trouble or self._inputs.trouble

    def _check_machine(self) -> None:
        self.stream.report_trouble(self._outputs.trouble_with(self._machine_trouble()))

    def _reset_outputs(self, request: Any, response: Any) -> str:
        return self._outputs.reset() or 'nothing was missed'

    def _restart_stream(self) -> str:
        """Deactivate and activate the node, so that a new stream uses the new calibration file.

        Returns the reason of the failure if the node is not active afterwards, otherwise ''.
        """
        self.trigger_deactivate()
        self.trigger_activate()
        return '' if self.state == 'active' else self._failure

    def diagnose(self, now: float) -> list[Finding]:
        """Return the findings on source, samples, clocks, photo-eyes, outputs and inputs."""
        source, trouble, figures = self._source, '', {}
        if source is not None and self.state == 'active':
            trouble, figures = source.trouble, source.figures()
        return [
            *self._watch.findings(now, time.time() - time.monotonic(), trouble, figures),
            self._host_clock.finding(now),
            self._outputs.finding(),
            self._inputs.finding(),
        ]


main = partial(run, DriverNode)

if __name__ == '__main__':
    main()
