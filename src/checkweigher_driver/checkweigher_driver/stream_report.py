"""What the driver says of a stream on load_cell/status."""

import time

from checkweigher_driver.stream_memory import StreamMemory
from checkweigher_dsp.records import StreamState, StreamStatus
from checkweigher_dsp.ros.outputs import LOCK, Output
from checkweigher_recording.pacing import FlowControl

# s from the beginning on. A reader that DDS shows to be there may not know the writer yet, and then
# hears of a stream with the next heartbeat, after 3 s: its first items it takes for other ones.
_SAID_AGAIN = (0.2, 0.5, 1.0)


class StreamReport:
    """Tell of one stream that it is running, how far it is, and how it ended; from any thread.

    Parameters
    ----------
    output : Output
        Of StreamStatus.
    memory : StreamMemory
        Number, stamp and edges of the stream.
    flow : FlowControl
        Its samples.

    Attributes
    ----------
    open : bool
        Whether samples flow, so that what is wrong with the machine is of interest.
    """

    def __init__(self, output: Output, memory: StreamMemory, flow: FlowControl) -> None:
        self.open = False
        self._output, self._memory, self._flow = output, memory, flow
        self._again: list[float] = []

    def begin(self) -> None:
        """Take that samples begin to flow."""
        self.open = True
        self._again = [time.monotonic() + seconds for seconds in _SAID_AGAIN]

    def say_again(self, trouble: str) -> None:
        """Say that the stream is running, a few times as long as it is young."""
        if self._again and time.monotonic() > self._again[0]:
            del self._again[0]
            self.send(StreamState.RUNNING, trouble)

    def send(self, state: StreamState, text: str = '') -> None:
        """Say how far the stream is; once it has ended, no trouble any more."""
        with LOCK:
            if text and state == StreamState.RUNNING and not self.open:
                return
            self.open &= state == StreamState.RUNNING
            self._output.send(
                StreamStatus(
                    self._memory.stamp,
                    self._memory.stream,
                    state,
                    self._flow.samples_sent,
                    self._memory.edges_sent,
                    text=text,
                )
            )
