"""One stream as the driver sent it: how far it is, and the latest edges and verdicts."""

from collections import deque

from checkweigher_dsp.records import (
    EyeEdge,
    LineHistory,
    SampleBlock,
    StreamState,
    StreamStatus,
    Verdict,
)
from checkweigher_recording.pacing import FlowControl
from checkweigher_recording.recording import Event

# 20 s and more at five items a second.
_MAX_EDGES = 400
_MAX_VERDICTS = 200


class SentStream:
    """Events of one stream, by its number.

    Attributes
    ----------
    number : int
    flow : FlowControl
        Events on their way to the line.
    edges_sent : int
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.flow = FlowControl()
        self.edges_sent = 0
        self._stamp = 0  # ns, of the last block
        self._edges: deque[EyeEdge] = deque(maxlen=_MAX_EDGES)
        self._verdicts: deque[Verdict] = deque(maxlen=_MAX_VERDICTS)

    def add(self, event: Event) -> None:
        """Take an event that is about to be sent."""
        self.flow.sent(event)
        if isinstance(event, SampleBlock):
            self._stamp = event.stamp
        elif isinstance(event, EyeEdge):
            self._edges.append(event)
            self.edges_sent += 1

    def add_verdict(self, verdict: Verdict) -> None:
        """Take a verdict that came."""
        self._verdicts.append(verdict)
        self.flow.judged(verdict.estimate_id or verdict.item_id)  # as the segmenter counts

    def history(self) -> LineHistory:
        """Return the latest edges and verdicts."""
        return LineHistory(
            stream=self.number,
            stamp=self._stamp,
            first_edge=self.edges_sent - len(self._edges),
            edges=tuple(self._edges),
            verdicts=tuple(self._verdicts),
        )

    def status(self, state: StreamState, text: str) -> StreamStatus:
        """Return how far the stream is."""
        return StreamStatus(
            self._stamp, self.number, state, self.flow.samples_sent, self.edges_sent, text=text
        )
