"""What the driver remembers of the stream that it sends."""

from collections import deque

from checkweigher_dsp.records import EyeEdge, LineHistory, Verdict

# 20 s and more at five items a second.
_MAX_EDGES = 400
_MAX_VERDICTS = 200


class StreamMemory:
    """The latest edges and verdicts of one stream.

    Parameters
    ----------
    stream : int
        Its number.

    Attributes
    ----------
    edges_sent : int
    stamp : int
        ns, of the last block that was sent.
    """

    def __init__(self, stream: int) -> None:
        self.stream = stream
        self.edges_sent = 0
        self.stamp = 0
        self._edges: deque[EyeEdge] = deque(maxlen=_MAX_EDGES)
        self._verdicts: deque[Verdict] = deque(maxlen=_MAX_VERDICTS)

    def add_edge(self, edge: EyeEdge) -> None:
        """Take an edge that is about to be sent."""
        self._edges.append(edge)
        self.edges_sent += 1

    def add_verdict(self, verdict: Verdict) -> None:
        """Take a verdict that came."""
        self._verdicts.append(verdict)

    def history(self) -> LineHistory:
        """Return all that is remembered."""
        return LineHistory(
            stream=self.stream,
            stamp=self.stamp,
            first_edge=self.edges_sent - len(self._edges),
            edges=tuple(self._edges),
            verdicts=tuple(self._verdicts),
        )
