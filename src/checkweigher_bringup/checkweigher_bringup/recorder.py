# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorder that writes the serialized messages of a lane unchanged to a bag."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
import math
from pathlib import Path
import queue
import time

from rclpy.serialization import deserialize_message, serialize_message
from tqdm import tqdm

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import asked_to_end, spinning
from checkweigher_core.printable import one_line
from checkweigher_core.records import GRAMS, Decision, Reference, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import stamp_from, to_message
from checkweigher_core.ros.graph.policy import OBSERVER
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.ports import Port
from checkweigher_recording.bags.writing import BagWriter

# Reasons of a FAULT for which a pass of the known mass is counted nevertheless. The window of the
# pass is complete, and training may remove the cause of the FAULT.
_OF_USE = {Reason.SPEED_NOT_TRAINED, Reason.NO_CONVERGENCE, Reason.NO_PRODUCT}
_POLL_PERIOD = 0.2  # s
_FLUSH_PERIOD = 1.0  # time in s between flushes; a kill loses the messages of about this time
_FAREWELL = 1.0  # maximum time in s after a signal in which messages in transit are recorded
_PATIENCE = 5.0  # time in s without a message after which a warning is printed
_TRAIL = 1.0  # time in s after the last verdict in which the product leaves the belt


class ReferencePasses:
    """Passes of products with the same known mass in kg.

    The recording ends after `wanted` passes, or has no limit if `wanted` is None. `count` is the
    number of passes so far that have a complete window.
    """

    def __init__(self, mass: float, wanted: int | None) -> None:
        self.count = 0
        self._news: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._mass = mass
        self._wanted = wanted or math.inf
        self._of = f' of {wanted}' if wanted else ''
        self._last = 0.0

    @property
    def done(self) -> bool:
        """True if the wanted number of passes was counted, and the last product has left the belt.

        The product is assumed to leave the belt within `_TRAIL` s after its verdict.
        """
        return self.count >= self._wanted and time.monotonic() > self._last + _TRAIL

    def lines(self) -> Iterator[str]:
        """Yield one line of text for each pass since the last call. Any thread may call this."""
        while not self._news.empty():
            yield one_line(self._news.get())

    def take(self, verdict: Verdict) -> Reference | None:
        """Count the pass of a verdict, and return the known mass, stamped with t1.

        A verdict does not count if it has no t1, or if it is a FAULT with a reason that is not in
        `_OF_USE`. Returns None if the verdict does not count, or if the wanted passes were counted
        before.
        """
        if self.count >= self._wanted:
            return None
        reasons = ', '.join(verdict.reasons)
        fault = verdict.decision == Decision.FAULT and not _OF_USE.issuperset(verdict.reasons)
        if fault or verdict.t1 is None:
            self._news.put(f'a pass that was not weighed: {reasons}')
            return None
        self.count += 1
        self._last = time.monotonic()
        found = f'{GRAMS * verdict.mass:.3f} g, {GRAMS * (verdict.mass - self._mass):+.3f} g'
        if math.isnan(verdict.mass):
            found = f'no mass yet: {reasons}'
        self._news.put(f'pass {self.count}{self._of}: {found}')
        return Reference(verdict.t1, self._mass)


class RecorderNode(PortNode):
    """Node that receives the serialized messages of a lane.

    The queue `messages` contains the port, the arrival time in ns, and the bytes of each message.
    Any thread may read the queue. If `passes` is given, its known mass is recorded for each pass
    instead of the reference masses that the line publishes.
    """

    def __init__(
        self, recorded: tuple[Port, ...], passes: ReferencePasses | None, name: str = 'record'
    ) -> None:
        super().__init__(name)
        self.messages: queue.Queue[tuple[Port, int, bytes]] = queue.Queue()
        self.passes = passes
        self._begin: int | None = None  # stamp in ns of the first samples
        self._flushed = time.monotonic()
        # Use the QoS of the stages, which does not request earlier verdicts. The bag lacks the
        # signals of items whose verdicts were published before the recording.
        for port in recorded:
            if passes is None or port is not ports.REFERENCE_MASS:
                put = partial(self._put, port)
                self.create_subscription(port.type, port.name, put, port.stage_qos, raw=True)
        if passes is not None:
            self.subscribe(ports.VERDICT, self._on_verdict)

    def write(self, bag: BagWriter) -> bool:
        """Write the next message if it arrives within 0.2 s, and return whether it has arrived.

        If the latest flush of the bag was more than a second ago, the bag is flushed.

        Raises `OutputError` if the bag cannot be written.
        """
        arrived = False
        with suppress(queue.Empty):
            bag.put(*self.messages.get(timeout=_POLL_PERIOD))
            arrived = True
        if time.monotonic() - self._flushed > _FLUSH_PERIOD:
            self._flushed = time.monotonic()
            bag.flush()
        return arrived

    def _put(self, port: Port, data: bytes) -> None:
        if self._begin is None and port is ports.LOAD_CELL_SAMPLES:
            self._begin = stamp_from(deserialize_message(data, port.type).header.stamp)
        self.messages.put((port, time.time_ns(), data))

    def _on_verdict(self, verdict: Verdict) -> None:
        assert self.passes is not None
        # The bag lacks the signal of an item that was on the belt before the first samples, so its
        # pass is not counted.
        if verdict.t1 is not None and (self._begin is None or verdict.t1 < self._begin):
            return
        if (reference := self.passes.take(verdict)) is not None:
            message = to_message(ports.REFERENCE_MASS, reference)
            self._put(ports.REFERENCE_MASS, serialize_message(message))


def record(
    path: Path,
    namespace: str,
    duration: float = math.inf,
    *,
    inputs_only: bool = False,
    passes: ReferencePasses | None = None,
) -> None:
    """Record a lane until `duration` s have passed, all `passes` are recorded, or a signal arrives.

    The signals are SIGINT, SIGTERM and SIGHUP. If this process is killed, the bag lacks the
    messages of about the last second and the file ``metadata.yaml``. With `inputs_only`, results
    are not recorded, because a replay computes them again.

    Raises `OutputError` if the bag cannot be written. Raises `UserError` and leaves no bag if no
    message arrives.
    """
    recorded = ports.PLAYED if inputs_only else ports.RECORDED
    with (
        asked_to_end() as asked,
        BagWriter(path, recorded, namespace, in_place=True) as bag,
        spinning(namespace, OBSERVER) as spinner,
    ):
        node = RecorderNode(recorded, passes)
        spinner.add(node)
        _write_until(time.monotonic() + duration, bag, node, asked)
        while not node.messages.empty():
            node.write(bag)
        count = bag.message_count
        if count == 0:
            topic = node.resolve_topic_name(ports.LOAD_CELL_SAMPLES.name)
            raise UserError(
                f'{path}: nothing was recorded: no message on {topic}; is the line running?'
            )
    print(f'{path}: {count} messages' + (f', {passes.count} passes' if passes else ''))


def _write_until(end: float, bag: BagWriter, node: RecorderNode, asked: Sequence[int]) -> None:
    """Write messages until the time `end` in s, all passes are recorded, or a signal arrives.

    After a signal, messages in transit are written until none arrives for `_POLL_PERIOD` s, for at
    most `_FAREWELL` s and not beyond `end`.
    """
    passes, silent_since = node.passes, time.monotonic()
    with tqdm(desc='recording', unit=' messages', disable=None, leave=False) as progress:
        while not asked and (now := time.monotonic()) < end and not (passes and passes.done):
            if _write_next(bag, node, progress):
                silent_since = now
            elif now - silent_since > _PATIENCE:
                silent_since = now
                progress.write(f'no messages for {_PATIENCE:.0f} s')
        end = min(end, time.monotonic() + _FAREWELL)
        while asked and time.monotonic() < end and _write_next(bag, node, progress):
            pass


def _write_next(bag: BagWriter, node: RecorderNode, progress: tqdm) -> bool:
    """Print a line for each new pass, write the next message, and return whether it arrived."""
    for line in node.passes.lines() if node.passes else ():
        progress.write(line)
    arrived = node.write(bag)
    progress.update(int(arrived))
    return arrived
