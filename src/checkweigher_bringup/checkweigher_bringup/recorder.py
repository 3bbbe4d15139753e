"""What `record` does: the messages of a lane, byte for byte as they come, into a bag."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
import queue
import signal
import time
from types import FrameType

from rclpy.node import Node
from tqdm import tqdm

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import spinning
from checkweigher_driver.bag_file import BagFile
from checkweigher_driver.bag_messages import INPUT_TOPICS, OUTPUT_TOPICS, Topic
from checkweigher_dsp.nodes import topics

_POLL_PERIOD = 0.2  # s
_PATIENCE = 5.0  # s without a message before that is said


class RecorderNode(Node):
    """Queue the serialized messages of a lane.

    Attributes
    ----------
    messages : queue of (Topic, int, bytes)
        Topic, time of arrival in ns and message; read from any thread.
    """

    def __init__(self, recorded: tuple[Topic, ...]) -> None:
        super().__init__('record')
        self.messages: queue.SimpleQueue[tuple[Topic, int, bytes]] = queue.SimpleQueue()
        profiles = {topic.name: topic for topic in topics.ALL}
        for topic in recorded:
            profile = profiles[topic.name]
            # What is kept for late joiners is wanted of the latched topics only: old verdicts
            # would belong to items that are not in the recording.
            qos = profile.qos if topic.latched else profile.stage_qos
            self.create_subscription(profile.type, profile.name, self._taker(topic), qos, raw=True)

    def _taker(self, topic: Topic) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            self.messages.put((topic, time.time_ns(), data))

        return take


def record(path: Path, namespace: str, duration: float | None, *, inputs_only: bool = False) -> int:
    """Record until the duration is over or SIGINT or SIGTERM comes; return the exit status.

    Parameters
    ----------
    path : Path
        Bag to write.
    namespace : str
        Of the lane.
    duration : float or None
        s.
    inputs_only : bool
        Whether to leave out what a replay makes anew.

    Raises
    ------
    OutputError
        If the bag cannot be written.
    UserError
        If no message came: an empty bag is of no use, so none is left.
    """
    recorded = INPUT_TOPICS if inputs_only else (*INPUT_TOPICS, *OUTPUT_TOPICS)

    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, end)
    with BagFile(path, recorded, namespace) as bag, spinning(namespace) as spinner:
        node = RecorderNode(recorded)
        spinner.add(node)
        with suppress(KeyboardInterrupt):
            _take(bag, node, duration)
        while not node.messages.empty():
            bag.put(*node.messages.get())
        if bag.message_count == 0:
            raise UserError(
                f'{path}: nothing was recorded: no message came on '
                f'{node.resolve_topic_name(topics.LOAD_CELL_SAMPLES.name)}; is the line running?'
            )
        count = bag.message_count
    print(f'{path}: {count} messages')
    return 0


def _take(bag: BagFile, node: RecorderNode, duration: float | None) -> None:
    end = None if duration is None else time.monotonic() + duration
    silent_since = time.monotonic()
    with tqdm(desc='recording', unit=' messages', disable=None, leave=False) as progress:
        while end is None or time.monotonic() < end:
            try:
                message = node.messages.get(timeout=_POLL_PERIOD)
            except queue.Empty:
                if time.monotonic() - silent_since > _PATIENCE:
                    silent_since = time.monotonic()
                    progress.write(f'no messages for {_PATIENCE:.0f} s')
                continue
            bag.put(*message)
            progress.update()
            silent_since = time.monotonic()
