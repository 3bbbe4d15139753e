# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Action and services for the calibration of a load cell on a running line."""

from collections.abc import Callable
from dataclasses import asdict, replace
import math
from pathlib import Path
import time
from typing import Any

from checkweigher_msgs.action import ReadLoad
from checkweigher_msgs.srv import CalibrateSpan, FinishCalibration
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from checkweigher_core.changes import CALIBRATION
from checkweigher_core.parameters import ParameterError, SettingsError
from checkweigher_core.records import GRAMS, EyeEdge, LoadCell, SampleBlock
from checkweigher_core.ros import ports
from checkweigher_core.ros.line_parameters import in_time
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_driver.calibration.file import (
    check_calibrated_source,
    check_calibration_file,
    read_calibration,
    write_version,
)
from checkweigher_driver.calibration.session import CalibrationParameters, CalibrationSession
from checkweigher_driver.calibration.static_calibration import (
    CalibrationError,
    RestReading,
    StaticCalibration,
    StaticReading,
)

# Time in s that is added to the parameter `patience` for the timeout of a call. The timeout is
# reached only if no samples arrive, because a reading otherwise ends within `patience`.
_SILENCE = 5.0

# Fields that StaticCalibration and the response of finish_calibration have in common.
_FITTED = ('counts_per_kg', 'counts_per_kg_uncertainty', 'zero_counts', 'zero_uncertainty')


class CalibrationServices:
    """Action that reads loads at rest, and services that fit and write a calibration.

    The function `restart` begins a new stream with the calibration, and returns the reason of a
    failure or an empty string.
    """

    def __init__(
        self,
        node: StageNode[Any],
        parameters: CalibrationParameters,
        source: str,
        restart: Callable[[], str],
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._source = source
        self._edges: dict[int, EyeEdge] = {}  # latest edge of each photo-eye in the stream
        self._stamp = 0  # stamp of the latest block in ns
        self._session: CalibrationSession | None = None  # None while the driver is inactive
        self._waiting: Future | None = None  # result for the call that waits, None if no call waits
        self._restart = restart
        # Function that publishes the feedback of the action, None if a service reads the load.
        self._tell: Callable[..., None] | None = None
        self._told: StaticReading | None = None  # latest reading in the feedback of the action
        node.create_action(ReadLoad, ports.READ_LOAD, self._on_read, self._cancel_reading)
        # With a separate callback group, other callbacks run while a call waits for a reading.
        group = self._group = ReentrantCallbackGroup()
        for kind, name, callback in (
            (Trigger, ports.CALIBRATE_ZERO, self._on_zero),
            (CalibrateSpan, ports.CALIBRATE_SPAN, self._on_span),
            (FinishCalibration, ports.FINISH_CALIBRATION, self._on_finish),
        ):
            node.create_service(kind, name, callback, callback_group=group)
        node.create_service(Trigger, ports.CANCEL_CALIBRATION, self._on_cancel)

    def apply(self, load_cell: LoadCell) -> LoadCell:
        """Return a load cell with the values of the calibration file.

        The load cell is returned unchanged if there is no calibration file, or if the source has no
        calibration parameters. Raises ParameterError if the calibration file is invalid.
        """
        found = self.read() or (load_cell.counts_per_kg, load_cell.zero_counts)
        return replace(load_cell, counts_per_kg=found[0], zero_counts=found[1])

    def read(self) -> tuple[float, float] | None:
        """Return counts_per_kg and zero_counts of the calibration file, or None without a file.

        The result is also None if the source has no calibration parameters. Raises ParameterError
        if the calibration file is invalid.
        """
        path = self._parameters.path
        try:
            return None if path is None else read_calibration(path, self._source)
        except (CalibrationError, SettingsError) as error:
            raise ParameterError(f'calibration.file: {error}') from None

    def begin(self, load_cell: LoadCell) -> None:
        """Begin a calibration session at the start of a stream of `load_cell`."""
        self._edges.clear()
        self._session = CalibrationSession(load_cell, self._parameters.steadiness)

    def end(self) -> None:
        """End the calibration session at the end of a stream, and discard its points.

        A call that waits for a reading fails.
        """
        self._session = None
        self._refuse('the driver was deactivated: activate it and begin again')

    def add(self, event: SampleBlock | EyeEdge) -> None:
        """Add an event of the stream to the present reading, if a call waits for a reading.

        The call ends when the reading is complete, or with an error if the load cannot be read. The
        caller must hold the lock of the process.
        """
        if isinstance(event, EyeEdge):
            self._edges[event.eye] = event
        else:
            self._stamp = event.stamp
        session, waiting = self._session, self._waiting
        if session is None or waiting is None:
            return
        reading = session.reading
        try:
            found = session.add(event, time.monotonic())
        except CalibrationError as error:
            self._refuse(str(error))
            return
        self._publish_progress(session.load_cell, reading)
        if found is not None:
            self._waiting = None
            waiting.set_result(found)

    def _publish_progress(self, cell: LoadCell, reading: RestReading | None) -> None:
        """Publish a new reading of the latest samples as feedback of the action.

        Nothing is published if a service reads the load, or if there is no new reading.
        """
        found = None if reading is None else reading.latest
        if self._tell is None or reading is None or found is None or found is self._told:
            return
        self._told, wanted = found, self._parameters.steadiness
        self._tell(
            load=float((found.mean - cell.zero_counts) / cell.counts_per_kg),
            drift=float(found.drift / cell.counts_per_kg),
            std_error=float(abs(found.std_error / cell.counts_per_kg)),
            tolerance=float(wanted.tolerance),
            duration=float(reading.duration),
            wanted=float(wanted.duration),
        )

    def _checked(self) -> tuple[CalibrationSession, Path]:
        """Return the calibration session and the path of the calibration file.

        Raises ValueError if the source has no calibration parameters, if the parameter `file` is
        empty or names a file that cannot be written, or if the driver is not active.
        """
        check_calibrated_source(self._source)
        path = self._parameters.path
        if path is None:
            raise CalibrationError(
                'calibration.file of the driver is empty; set it to the file of this machine'
            )
        check_calibration_file(path)
        if self._session is None:
            raise CalibrationError('the driver is not active, so no samples arrive; activate it')
        return self._session, path

    async def _on_read(self, goal: Any, result: Any, tell: Callable[..., None]) -> None:
        mass, uncertainty = float(goal.mass), float(goal.mass_uncertainty)
        if not mass >= 0:
            raise CalibrationError(f'mass {mass:g} kg: must be above 0, or 0 for the empty belt')
        result.message = await self._read(mass, uncertainty, result, tell)
        result.points = 0 if self._session is None else len(self._session.points)

    async def _on_zero(self, request: Any, response: Any) -> str:
        self._node.warn_of(ports.CALIBRATE_ZERO, ports.READ_LOAD)
        return await self._read(0.0, 0.0)

    async def _on_span(self, request: Any, response: Any) -> str:
        self._node.warn_of(ports.CALIBRATE_SPAN, ports.READ_LOAD)
        if not request.mass > 0:
            raise CalibrationError(f'mass {request.mass:g} kg: must be above 0')
        return await self._read(float(request.mass), float(request.mass_uncertainty), response)

    async def _read(
        self,
        mass: float,
        uncertainty: float,
        result: Any = None,
        tell: Callable[..., None] | None = None,
    ) -> str:
        """Read a load, write the reading to `result` unless it is None, and return a message.

        Raises ValueError if the load cannot be read.
        """
        try:
            session, _ = self._checked()
            session.begin(mass, uncertainty, self._edges.values())
            waiting = self._waiting = Future()
            self._tell, self._told = tell, None
            # Without this call, a result that another thread sets would not wake the executor.
            waiting.add_done_callback(lambda _: self._node.executor.wake())
            patience = self._parameters.patience + _SILENCE
            found: StaticReading | None = await in_time(self._node, self._group, waiting, patience)
            if found is None:
                self._waiting = session.reading = None
                raise CalibrationError('no samples arrive; check cable and power of the load cell')
        except ValueError as error:
            self._node.warn(f'calibration: {error}')
            raise
        if result is not None:
            result.reading, result.std_error = found.mean, found.std_error
        text = f'reading {found.mean:.1f} +- {found.std_error:.1f}'
        return f'{text}; readings so far: {len(session.points)}'

    def _refuse(self, text: str) -> None:
        """End the call that waits for a reading, if there is one, with the error `text`."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.set_exception(CalibrationError(text))

    def _cancel_reading(self) -> None:
        """Cancel the present reading of a load, if there is one. The points are kept."""
        if self._session is not None:
            self._session.reading = None
        self._refuse('cancelled')

    def _on_cancel(self, request: Any, response: Any) -> str:
        session = self._session
        self._refuse('cancelled')
        if session is not None:
            self._session = CalibrationSession(session.load_cell, self._parameters.steadiness)
        return f'{0 if session is None else len(session.points)} readings discarded'

    async def _on_finish(self, request: Any, response: Any) -> str:
        for name in _FITTED:
            setattr(response, name, math.nan)
        try:
            session, path = self._checked()
            edges, residual = self._edges.values(), float(request.max_residual)
            found = session.finish(residual, edges, self._stamp, time.monotonic())
            version = await self._write(session, path, found)
        except ValueError as error:
            self._node.warn(f'calibration: {error}')
            raise
        for name in _FITTED:
            setattr(response, name, float(getattr(found, name)))
        response.masses = [float(point.mass) for point in session.points]
        response.residuals = [float(residual) for residual in found.residuals]
        response.file, response.version = str(path), version
        text = f'{_change(session.load_cell, found)}; version {version} of {path}'
        if trouble := self._restart():
            text += f'; but the driver cannot restart: {trouble}'
        self._node.get_logger().info(f'calibration: {text}')
        return text

    async def _write(
        self, session: CalibrationSession, path: Path, found: StaticCalibration
    ) -> int:
        """Write a calibration to the audit log and then to its file; return the file version.

        Raises ValueError if the log or the file cannot be written, or if the stream was restarted
        in the meantime. If the calibration is written to the log but not to the file, the previous
        calibration is then added to the log.
        """
        before = session.load_cell
        after = replace(before, counts_per_kg=found.counts_per_kg, zero_counts=found.zero_counts)
        change = CALIBRATION, ports.LOAD_CELL_INFO.name
        if reason := await self._node.change_record.write(*change, asdict(after)):
            raise CalibrationError(reason)
        try:
            if self._session is not session:
                raise CalibrationError('the stream was restarted in the meantime: begin again')
            return write_version(path, self._source, found, session.points)
        except ValueError:
            await self._node.change_record.write(*change, asdict(before))
            raise


def _change(before: LoadCell, found: StaticCalibration) -> str:
    return (
        f'counts_per_kg {before.counts_per_kg:.4f} -> {found.counts_per_kg:.4f}, zero_counts '
        f'{before.zero_counts:.2f} -> {found.zero_counts:.2f}, largest residual '
        f'{GRAMS * found.largest_residual:.4f} g'
    )
