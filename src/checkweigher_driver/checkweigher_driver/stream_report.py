"""What the driver says of a stream on load_cell/status."""

import threading
import time

from checkweigher_msgs.msg import StreamStatus
from rclpy.publisher import Publisher

from checkweigher_driver.stream_memory import StreamMemory
from checkweigher_dsp.ros.conversion import header_to
from checkweigher_recording.pacing import FlowControl

# s from the beginning on. A reader that DDS shows to be there may not know the writer yet, and then
# hears of a stream with the next heartbeat, after 3 s: its first items it takes for other ones.
_SAID_AGAIN = (0.2, 0.5, 1.0)


class StreamReport:
    """Tell of one stream that it is running, how far it is, and how it ended; from any thread.

    Parameters
    ----------
    publisher : Publisher
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

    def __init__(self, publisher: Publisher, memory: StreamMemory, flow: FlowControl) -> None:
        self.open = False
        self._publisher, self._memory, self._flow = publisher, memory, flow
        self._order = threading.Lock()
        self._again: list[float] = []

    def begin(self) -> None:
        """Take that samples begin to flow."""
        self.open = True
        self._again = [time.monotonic() + seconds for seconds in _SAID_AGAIN]

    def say_again(self, trouble: str) -> None:
        """Say that the stream is running, a few times as long as it is young."""
        if self._again and time.monotonic() > self._again[0]:
            del self._again[0]
            self.publish(StreamStatus.RUNNING, trouble)

    def publish(self, state: int, text: str = '') -> None:
        """Publish how far the stream is; once it has ended, no trouble any more."""
        with self._order:
            if text and state == StreamStatus.RUNNING and not self.open:
                return
            self.open &= state == StreamStatus.RUNNING
            self._publisher.publish(
                StreamStatus(
                    header=header_to(self._memory.stamp),
                    stream=self._memory.stream,
                    state=state,
                    samples=self._flow.samples_sent,
                    edges=self._memory.edges_sent,
                    text=text,
                )
            )
