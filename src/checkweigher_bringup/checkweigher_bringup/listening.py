"""What `echo` shows of a running graph."""

from collections import deque
import queue
import sys
import time
from typing import Any

from rclpy.node import Node

from checkweigher_bringup.output import Table
from checkweigher_bringup.spinning import spinning
from checkweigher_dsp.line import Weighing
from checkweigher_dsp.nodes import topics
from checkweigher_dsp.nodes.conversion import estimate_from, reference_from, verdict_from
from checkweigher_dsp.nodes.topics import Topic
from checkweigher_dsp.records import MassEstimate, Reference, Verdict
from checkweigher_validation.results import ItemResult, ResultJoiner

_PATIENCE = 5.0  # s without a verdict before the reason is looked for
_POLL_PERIOD = 0.2  # s
# References that are kept for the items still on the line.
_MAX_REFERENCES = 100


class ResultListener(Node):
    """Pair the estimates and verdicts of a lane.

    Parameters
    ----------
    from_start : bool
        Whether to ask for the results from before the listener was there.

    Attributes
    ----------
    weighings : queue of Weighing
        What has been paired; read from any thread.
    heard : float
        When something came last, s of the monotonic clock.
    """

    def __init__(self, name: str, *, from_start: bool) -> None:
        super().__init__(name)
        self.weighings: queue.SimpleQueue[Weighing] = queue.SimpleQueue()
        self.heard = time.monotonic()
        self.judged = 0
        self._from_start = from_start
        self._estimates: dict[int, MassEstimate] = {}
        self._verdicts: dict[int, Verdict] = {}
        self.listen(topics.MASS_ESTIMATE, self._on_estimate)
        self.listen(topics.VERDICT, self._on_verdict)

    def listen(self, topic: Topic, callback: Any) -> None:
        """Subscribe to a topic of the lane."""
        qos = topic.qos if self._from_start else topic.stage_qos
        self.create_subscription(topic.type, topic.name, callback, qos)

    def _on_estimate(self, message: Any) -> None:
        estimate = estimate_from(message)
        self._estimates[estimate.item_id] = estimate
        self._match(estimate.item_id)

    def _on_verdict(self, message: Any) -> None:
        verdict = verdict_from(message)
        self._verdicts[verdict.item_id] = verdict
        self._match(verdict.item_id)

    def _match(self, item_id: int) -> None:
        self.heard = time.monotonic()
        if item_id in self._estimates and item_id in self._verdicts:
            self.judged += 1
            self.weighings.put(Weighing(self._estimates.pop(item_id), self._verdicts.pop(item_id)))


class EchoNode(ResultListener):
    """Listen to results and to the known masses."""

    def __init__(self) -> None:
        super().__init__('echo', from_start=False)
        self._references: deque[Reference] = deque(maxlen=_MAX_REFERENCES)
        self.listen(topics.REFERENCE_MASS, lambda m: self._references.append(reference_from(m)))

    def result(self, weighing: Weighing) -> ItemResult:
        """Return a weighing with its known mass, if there is one."""
        joiner = ResultJoiner((), list(self._references))
        return joiner.join(weighing.estimate, weighing.verdict)

    def silence(self) -> str:
        """Say why nothing may be coming."""
        for topic in (topics.LOAD_CELL_SAMPLES, topics.PHOTO_EYES, topics.VERDICT):
            name = self.resolve_topic_name(topic.name)
            if self.count_publishers(name) == 0:
                return f'no verdict yet: nobody publishes {name}; is the line running, and here?'
        return 'no verdict yet: the line is running, but no product has passed'


def echo(namespace: str, count: int | None, duration: float | None) -> None:
    """Print one line a verdict.

    Parameters
    ----------
    namespace : str
        Of the lane.
    count : int or None
        Verdicts after which to end.
    duration : float or None
        s after which to end.
    """
    end = None if duration is None else time.monotonic() + duration
    table: Table | None = None
    shown = 0
    with spinning(namespace) as spinner:
        node = EchoNode()
        spinner.add(node)
        try:
            while (count is None or shown < count) and (end is None or time.monotonic() < end):
                try:
                    weighing = node.weighings.get(timeout=_POLL_PERIOD)
                except queue.Empty:
                    if time.monotonic() - node.heard > _PATIENCE:
                        node.heard = time.monotonic()
                        print(node.silence(), file=sys.stderr, flush=True)
                    continue
                table = table or Table(weighing.estimate.t1 or weighing.estimate.t3 or 0)
                table.show(node.result(weighing))
                shown += 1
        except KeyboardInterrupt:
            pass
    if table is not None:
        table.close()
