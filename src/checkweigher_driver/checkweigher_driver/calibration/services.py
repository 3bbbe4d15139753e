"""The services by which a load cell is calibrated on a line that runs."""

from collections.abc import Callable
from dataclasses import replace
import queue
import time
from typing import Any

from checkweigher_msgs.srv import CalibrateSpan, FinishCalibration
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from checkweigher_driver.calibration.file import (
    check_calibrated_source,
    check_calibration_file,
    read_calibration,
    write_version,
)
from checkweigher_driver.calibration.session import CalibrationParameters, CalibrationSession
from checkweigher_driver.calibration.static_calibration import (
    GRAMS,
    CalibrationError,
    StaticCalibration,
    StaticReading,
)
from checkweigher_driver.stream_memory import StreamMemory
from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.records import EyeEdge, LoadCell, SampleBlock
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.stage_node import StageNode

_LOOK_PERIOD = 0.05  # s
_SILENCE = 5.0  # s without an answer of the samples beyond the patience that they have


class CalibrationServices:
    """Read loads at rest, calibrate, write it down and have the driver weigh by it.

    Parameters
    ----------
    node : StageNode
        Offers the services.
    parameters : CalibrationParameters
        File and steadiness.
    source : str
        Whose calibration it is.
    memory : callable
        Gives what is remembered of the stream.
    restart : callable
        Begins a new stream; returns why that could not be done, else nothing.
    """

    def __init__(
        self,
        node: StageNode[Any],
        parameters: CalibrationParameters,
        source: str,
        memory: Callable[[], StreamMemory],
        restart: Callable[[], str],
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._source = source
        self._memory = memory
        self._restart = restart
        self._session: CalibrationSession | None = None
        self._events: queue.SimpleQueue[SampleBlock | EyeEdge] = queue.SimpleQueue()
        self._listening = False
        self._answer: Future | None = None
        self._until = 0.0
        self._timer = node.create_timer(_LOOK_PERIOD, self._look)
        self._timer.cancel()
        # A group of its own: samples go on while an answer waits for them.
        group = ReentrantCallbackGroup()
        node.create_service(Trigger, ports.CALIBRATE_ZERO, self._on_zero, callback_group=group)
        node.create_service(
            CalibrateSpan, ports.CALIBRATE_SPAN, self._on_span, callback_group=group
        )
        node.create_service(FinishCalibration, ports.FINISH_CALIBRATION, self._on_finish)
        node.create_service(Trigger, ports.CANCEL_CALIBRATION, self._on_cancel)

    def read(self) -> tuple[float, float] | None:
        """Return counts_per_kg and zero_counts of the file, None if there is none.

        Raises
        ------
        ParameterError
            If the file cannot be used.
        """
        path = self._parameters.path
        try:
            return None if path is None else read_calibration(path, self._source)
        except CalibrationError as error:
            raise ParameterError(f'calibration.file: {error}') from None

    def apply(self, load_cell: LoadCell) -> LoadCell:
        """Return the load cell with the calibration of the file, if there is one."""
        found = self.read()
        if found is None:
            return load_cell
        return replace(load_cell, counts_per_kg=found[0], zero_counts=found[1])

    def begin(self, load_cell: LoadCell) -> None:
        """Take that a stream of a load cell begins."""
        self._session = CalibrationSession(load_cell, self._parameters.steadiness)

    def end(self) -> None:
        """Take that the stream has ended, and with it what was read."""
        self._session = None
        self._reply(False, 'the driver was deactivated: activate it and begin anew')

    def add(self, event: SampleBlock | EyeEdge) -> None:
        """Take what was published; from any thread."""
        if self._listening:
            self._events.put(event)

    def _checked(self) -> CalibrationSession:
        """Return the session of a driver that can be calibrated."""
        check_calibrated_source(self._source)
        path = self._parameters.path
        if path is None:
            raise CalibrationError(
                'calibration.file of the driver is empty; name the file of this machine there'
            )
        check_calibration_file(path)
        if self._session is None:
            raise CalibrationError('the driver is not active, so no samples come; activate it')
        return self._session

    async def _on_zero(self, request: Any, response: Any) -> Any:
        response.success, response.message, _ = await self._read(0.0, 0.0)
        return response

    async def _on_span(self, request: Any, response: Any) -> Any:
        response.success, response.message, found = (
            await self._read(float(request.mass), float(request.mass_uncertainty))
            if request.mass > 0
            else (False, f'mass {request.mass:g} kg: must be above 0; calibrate_zero reads '
                  'the empty belt', None)
        )  # fmt: skip
        if found is not None:
            response.reading, response.std_error = found.mean, found.std_error
        return response

    async def _read(self, mass: float, uncertainty: float) -> Any:
        """Read a load and return whether that went well, what to say, and the reading."""
        try:
            self._checked().begin(mass, uncertainty, self._memory().history().edges)
        except ValueError as error:
            self._node.warn(f'calibration: {error}')
            return False, str(error), None
        while not self._events.empty():
            self._events.get()
        self._until = time.monotonic() + self._parameters.patience + _SILENCE
        self._answer, self._listening = Future(), True
        self._timer.reset()
        return await self._answer

    def _look(self) -> None:
        """Take what has come of the load that is being read."""
        session = self._session
        if session is None:
            return
        try:
            while not self._events.empty():
                found = session.add(self._events.get(), time.monotonic())
                if found is not None:
                    text = f'reading {found.mean:.1f} +- {found.std_error:.1f}'
                    self._reply(True, f'{text}; {len(session.points)} read by now', found)
                    return
            if time.monotonic() > self._until:
                raise CalibrationError('no samples come; check cable and power of the load cell')
        except CalibrationError as error:
            self._reply(False, str(error))

    def _reply(self, done: bool, text: str, found: StaticReading | None = None) -> None:
        self._timer.cancel()
        self._listening = False
        answer, self._answer = self._answer, None
        if answer is None:
            return
        if not done:
            if self._session is not None:
                self._session.cancel()
            self._node.warn(f'calibration: {text}')
        answer.set_result((done, text, found))

    def _on_cancel(self, request: Any, response: Any) -> Any:
        """Forget what was read."""
        session = self._session
        read = 0 if session is None else len(session.points)
        self._reply(False, 'cancelled')
        if session is not None:
            self.begin(session.load_cell)
        response.success, response.message = True, f'{read} readings forgotten'
        return response

    def _on_finish(
        self, request: FinishCalibration.Request, response: FinishCalibration.Response
    ) -> FinishCalibration.Response:
        nan = float('nan')
        response.counts_per_kg = response.counts_per_kg_uncertainty = nan
        response.zero_counts = response.zero_uncertainty = nan
        try:
            session = self._checked()
            history = self._memory().history()
            found = session.finish(
                float(request.max_residual), history.edges, history.stamp, time.monotonic()
            )
            path = self._parameters.path
            assert path is not None
            version = write_version(path, self._source, found, session.points)
        except ValueError as error:
            response.message = str(error)
            self._node.warn(f'calibration: {error}')
            return response
        response.success = True
        response.file, response.version = str(path), version
        _fill(response, found, session)
        trouble = self._restart()
        response.message = f'{_change(session.load_cell, found)}; version {version} of {path}' + (
            f'; but the driver does not start again: {trouble}' if trouble else ''
        )
        self._node.get_logger().info(f'calibration: {response.message}')
        return response


def _fill(
    response: FinishCalibration.Response, found: StaticCalibration, session: CalibrationSession
) -> None:
    for name in ('counts_per_kg', 'counts_per_kg_uncertainty', 'zero_counts', 'zero_uncertainty'):
        setattr(response, name, float(getattr(found, name)))
    response.masses = [float(point.mass) for point in session.points]
    response.residuals = [float(residual) for residual in found.residuals]


def _change(before: LoadCell, found: StaticCalibration) -> str:
    """Return what a calibration changes, in one line."""
    return (
        f'counts_per_kg {before.counts_per_kg:.4f} -> {found.counts_per_kg:.4f}, zero_counts '
        f'{before.zero_counts:.2f} -> {found.zero_counts:.2f}, largest residual '
        f'{GRAMS * found.largest_residual:.4f} g'
    )
