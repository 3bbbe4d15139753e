"""The driver node: publishes what a source of samples and photo-eye edges delivers."""

from collections.abc import Sequence
from dataclasses import dataclass
import threading
import time
from typing import Any, ClassVar

from checkweigher_msgs.msg import StreamStatus
from rclpy.publisher import Publisher

from checkweigher_driver.pacing import FlowControl, Pacer
from checkweigher_driver.recording import Event
from checkweigher_driver.sources import SOURCES, Source, source_class
from checkweigher_dsp.nodes import topics
from checkweigher_dsp.nodes.conversion import (
    edge_to,
    header_to,
    load_cell_to,
    reference_to,
    samples_to,
)
from checkweigher_dsp.nodes.shell import StageNode, declare, run
from checkweigher_dsp.nodes.topics import Topic
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.records import EyeEdge, LoadCell, Reference, SampleBlock

_PATIENCE = 5.0  # s without a segmenter before that is said


@dataclass(frozen=True)
class DriverParameters(Parameters):
    """Where samples and edges come from."""

    node: ClassVar[str] = 'driver'

    source: str = parameter(
        'simulator', 'where samples and edges come from', choices=tuple(SOURCES)
    )
    rate: float = parameter(
        1.0, 'pace of a recorded or simulated source, seconds of signal in a second; '
        '0 as fast as nothing is lost', minimum=0, maximum=1e6,
    )  # fmt: skip
    lossless: bool = parameter(
        True, 'hold a recorded or simulated source back until the segmenter has taken what was '
        'sent; false runs it without a segmenter',
    )  # fmt: skip


class DriverNode(StageNode[DriverParameters]):
    """Publish the events of a source: load_cell/info, load_cell/samples and photo_eyes.

    The source is read in a thread of its own, by blocking reads.
    """

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(DriverParameters, read_only=True, overrides=overrides)
        make_source = source_class(self.parameters.source)
        try:
            self._source: Source = make_source(
                declare(self, make_source.parameters, f'{self.parameters.source}.', read_only=True)
            )
        except ValueError as error:
            self.destroy_node()
            if isinstance(error, ParameterError):
                raise
            # The bag is damaged, or whatever else keeps the source from being opened.
            raise ParameterError(f'driver.source: {error}') from None
        self._changed = threading.Condition()
        self._stopping = False
        self._flow = FlowControl()
        self._stream_number = time.time_ns()  # no other driver's
        self._answered = False
        self._edges_sent = 0
        self._last_stamp = 0
        self._info = self._publisher_of(topics.LOAD_CELL_INFO)
        self._samples = self._publisher_of(topics.LOAD_CELL_SAMPLES)
        self._eyes = self._publisher_of(topics.PHOTO_EYES)
        self._references = self._publisher_of(topics.REFERENCE_MASS)
        self._status = self._publisher_of(topics.DRIVER_STATUS)
        self.subscribe(topics.SEGMENTER_STATUS, self._on_segmenter_status)
        self.subscribe(topics.VERDICT, self._on_verdict)
        self._thread = threading.Thread(target=self._run, name='source', daemon=True)
        self._thread.start()

    def _publisher_of(self, topic: Topic) -> Publisher:
        return self.create_publisher(topic.type, topic.name, topic.qos)

    def destroy_node(self) -> None:
        """Stop reading the source, then destroy the node."""
        if hasattr(self, '_thread'):
            with self._changed:
                self._stopping = True
                self._changed.notify_all()
            self._source.close()
            self._thread.join(timeout=2.0)
        super().destroy_node()

    def _on_segmenter_status(self, message: Any) -> None:
        with self._changed:
            if message.stream != self._stream_number:
                return
            if not self._answered:
                self._answered = True
                self._flow.items_judged = int(message.items)
            self._flow.taken(int(message.samples), int(message.items))
            self._changed.notify_all()

    def _on_verdict(self, message: Any) -> None:
        with self._changed:
            number = int(message.estimate_id) or int(message.item_id)  # as the segmenter counts
            self._flow.items_judged = max(self._flow.items_judged, number)
            self._changed.notify_all()

    def _run(self) -> None:
        """Publish until the source ends, and say how it ended."""
        try:
            self._stream(self._source.load_cell)
        except Exception as error:
            if self._stopping:
                return
            # Whatever breaks the source, the line must hear of it: items on the belt are faults.
            self.get_logger().error(f'source {self.parameters.source}: {error}')
            self._publish_status(StreamStatus.FAILED, str(error))
        else:
            if not self._stopping:
                self._publish_status(StreamStatus.FINISHED)

    def _stream(self, load_cell: LoadCell) -> None:
        self._info.publish(load_cell_to(load_cell, self._source.start_stamp))
        self._publish_status(StreamStatus.RUNNING)
        held_back = self._source.paced and self.parameters.lossless
        if held_back and not self._wait_for(self._has_listeners, 'a segmenter'):
            return
        pacer = Pacer(self.parameters.rate, load_cell.sample_rate, time.monotonic())
        for event in self._source:
            if self._source.paced and not self._wait_until(pacer.due(event)):
                return
            if held_back and isinstance(event, SampleBlock):
                block = event
                if not self._wait_for(
                    lambda: self._flow.may_send(block, load_cell.sample_rate),  # noqa: B023
                    'segmenter and verdicts to catch up',
                ):
                    return
            self._publish(event)

    def _has_listeners(self) -> bool:
        """Tell whether driver and segmenter have found each other, both of them."""
        return self._answered and all(
            publisher.get_subscription_count() > 0
            for publisher in (self._samples, self._eyes, self._status)
        )

    def _wait_for(self, condition: Any, what: str) -> bool:
        """Wait until a condition holds; return whether to go on."""
        with self._changed:
            asked = time.monotonic()
            while not self._stopping and not condition():
                self._changed.wait(timeout=0.02)
                if time.monotonic() - asked > _PATIENCE:
                    asked = time.monotonic()
                    self.warn(f'the source is held back: waiting for {what}')
            return not self._stopping

    def _wait_until(self, due: float) -> bool:
        """Wait until a time of the monotonic clock; return whether to go on."""
        with self._changed:
            while not self._stopping and (remaining := due - time.monotonic()) > 0:
                self._changed.wait(timeout=remaining)
            return not self._stopping

    def _publish(self, event: Event) -> None:
        if isinstance(event, SampleBlock):
            self._flow.samples_sent += len(event.counts)
            self._last_stamp = event.stamp
            self._samples.publish(samples_to(event))
            self.count('blocks')
        elif isinstance(event, EyeEdge):
            self._edges_sent += 1
            self._eyes.publish(edge_to(event))
            self.count('edges')
        elif isinstance(event, Reference):
            self._references.publish(reference_to(event))

    def _publish_status(self, state: int, text: str = '') -> None:
        self._status.publish(
            StreamStatus(
                header=header_to(self._last_stamp),
                stream=self._stream_number,
                state=state,
                samples=self._flow.samples_sent,
                edges=self._edges_sent,
                text=text,
            )
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the node."""
    run(DriverNode, arguments)


if __name__ == '__main__':
    main()
