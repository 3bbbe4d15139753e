"""The reject node: photo_eyes and mass_estimate to verdict; with reject_eye to stop_request."""

from collections.abc import Sequence
import time
from typing import Any

from std_srvs.srv import Trigger

from checkweigher_dsp.nodes import topics
from checkweigher_dsp.nodes.conversion import (
    edge_from,
    estimate_from,
    load_cell_from,
    stop_request_to,
    verdict_to,
)
from checkweigher_dsp.nodes.shell import HeldPublisher, StageNode, run
from checkweigher_dsp.records import Reason, StopRequest, Verdict
from checkweigher_dsp.reject_monitoring import RejectMonitor
from checkweigher_dsp.reject_timing import StreamClock
from checkweigher_dsp.rejection import RejectParameters, RejectStage

_TICK = 0.005  # s, well below verdict_margin


class RejectNode(StageNode[RejectParameters]):
    """Give every item that the eyes show its verdict, in time for the rejector."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(RejectParameters, overrides=overrides)
        self._verdicts = HeldPublisher(self, topics.VERDICT)
        self._stage = RejectStage(self.parameters)
        self._monitor = RejectMonitor(self.parameters)
        self._stream_clock = StreamClock(running=self.parameters.deadlines)
        self._stream = 0
        self._stop_requests = self.create_publisher(
            topics.STOP_REQUEST.type, topics.STOP_REQUEST.name, topics.STOP_REQUEST.qos
        )
        self._stop_request: StopRequest | None = None
        self._stop_requests.publish(stop_request_to(None))
        self.create_service(Trigger, topics.RESET_STOP_REQUEST, self._reset)
        self._timer = self.create_timer(_TICK, self._tick)
        self.subscribe(topics.LOAD_CELL_INFO, self._on_info)
        self.subscribe(topics.DRIVER_STATUS, self._on_driver_status)
        self.subscribe(topics.PHOTO_EYES, self._on_edge)
        self.subscribe(topics.MASS_ESTIMATE, self._on_estimate)
        self.subscribe(topics.REJECT_EYE, self._on_reject_eye)

    def on_parameters(self) -> None:
        """Begin to use changed limits."""
        self._stage.parameters = self._monitor.parameters = self.parameters
        self._stream_clock.running = self.parameters.deadlines

    def _now(self) -> int | None:
        """Return the time that deadlines run on, None if there are none."""
        return time.monotonic_ns() if self.parameters.deadlines else None

    def _on_info(self, message: Any) -> None:
        self._stage.set_weigh_length(load_cell_from(message).weigh_length, self._now())

    def _on_driver_status(self, message: Any) -> None:
        if message.stream == self._stream:
            return
        # The first one heard tells of the stream whose edges may be here already.
        if self._stream:
            self._stage.restart(self._now())
            self._monitor.restart()
        self._stream = int(message.stream)

    def _on_edge(self, message: Any) -> None:
        edge = edge_from(message)
        self._stream_clock.saw(edge.stamp, time.monotonic_ns())
        self._publish(self._stage.add_edge(edge, self._now()))
        self._timer.reset()

    def _on_estimate(self, message: Any) -> None:
        estimate = estimate_from(message)
        late = self._stage.late_estimates
        self._publish(self._stage.add_estimate(estimate, self._now()))
        if self._stage.late_estimates > late:
            self.count('late estimates')
            self.warn(f'item {estimate.item_id}: its mass came after its verdict')

    def _on_reject_eye(self, message: Any) -> None:
        edge = edge_from(message)
        self._stream_clock.saw(edge.stamp, time.monotonic_ns())
        self._monitor.add_edge(edge)
        self._timer.reset()

    def _tick(self) -> None:
        """Do what time alone brings, as long as there is something to wait for."""
        now = time.monotonic_ns()
        if self.parameters.deadlines:
            self._publish(self._stage.advance(now))
        strays = self._monitor.strays
        stream_time = self._stream_clock.at(now)
        if stream_time is not None:
            self._monitor.advance(stream_time)
        if self._monitor.strays > strays:
            self.count('reject_eye strays')
            self.warn('reject_eye saw something near no reject time')
        self._show_stop_request()
        if self._stage.due is None and not self._monitor.waiting:
            self._timer.cancel()

    def _publish(self, verdicts: list[Verdict]) -> None:
        for verdict in verdicts:
            self._verdicts.publish(verdict_to(verdict))  # before all else: the rejector waits
            self.count(verdict.decision.name)
            if not verdict.estimate_id:
                self.count(Reason.NO_ESTIMATE)
                self.warn(f'item {verdict.item_id}: NoEstimate: {Reason.NO_ESTIMATE.hint}')
            elif Reason.UNKNOWN_ITEM in verdict.reasons:
                self.count(Reason.UNKNOWN_ITEM)
                self.warn(f'item {verdict.item_id}: UnknownItem: {Reason.UNKNOWN_ITEM.hint}')
            if verdict.late:
                self.count('late verdicts')
                self.warn(f'item {verdict.item_id}: its verdict came after its reject time')
            self._monitor.add_verdict(verdict)
        if verdicts:
            self._show_stop_request()
            self._timer.reset()

    def _show_stop_request(self) -> None:
        request = self._monitor.request
        if request == self._stop_request:
            return
        self._stop_request = request
        self._stop_requests.publish(stop_request_to(request))
        if request is not None:
            self.count(request.reason)
            self.warn(f'stop: item {request.item_id}: {request.reason}: {request.reason.hint}')

    def _reset(self, request: Any, response: Any) -> Any:
        """Clear the stop request."""
        cleared = self._monitor.request
        self._monitor.reset()
        self._show_stop_request()
        response.success = True
        response.message = 'no stop was requested' if cleared is None else f'{cleared.reason} reset'
        return response


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the node."""
    run(RejectNode, arguments)


if __name__ == '__main__':
    main()
