# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorder that writes the messages of a lane to a bag, byte for byte."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
import math
from pathlib import Path
import queue
import time

from rclpy.serialization import serialize_message
from tqdm import tqdm

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import asked_to_end, spinning
from checkweigher_core.printable import one_line
from checkweigher_core.records import GRAMS, Decision, Reference, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.ports import Port
from checkweigher_recording.bags.writing import BagWriter

_POLL_PERIOD = 0.2  # s
_FLUSH_PERIOD = 1.0  # s; at most this much is lost if the process is killed
_FAREWELL = 1.0  # s, for messages in transit after a signal
_PATIENCE = 5.0  # s without a message before a warning
_TRAIL = 1.0  # s, for the last product to leave the belt
# Passes with these reasons count, because their window is whole and training may help.
_OF_USE = {Reason.SPEED_NOT_TRAINED, Reason.NO_CONVERGENCE, Reason.NO_PRODUCT}


class ReferencePasses:
    """Passes of products of one known mass in kg; the recording ends after `wanted` of them.

    `count` is the number of passes so far with a whole window.
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
        """True if all wanted passes have come, and the last product has left the belt."""
        return self.count >= self._wanted and time.monotonic() > self._last + _TRAIL

    def lines(self) -> Iterator[str]:
        """Yield a line for each new pass; may be called from any thread."""
        while not self._news.empty():
            yield one_line(self._news.get())

    def take(self, verdict: Verdict) -> Reference | None:
        """Count a pass; return its known mass, or None if it does not count."""
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
    """Recorder of the serialized messages of a lane, with port and time of arrival in ns.

    The queue `messages` may be read from any thread. The known mass of `passes` replaces the
    references of the line.
    """

    def __init__(
        self, recorded: tuple[Port, ...], passes: ReferencePasses | None, name: str = 'record'
    ) -> None:
        super().__init__(name)
        self.messages: queue.Queue[tuple[Port, int, bytes]] = queue.Queue()
        self.passes = passes
        self._flushed = time.monotonic()
        # QoS of the stages: it skips older verdicts, whose items are not recorded.
        for port in recorded:
            if passes is None or port is not ports.REFERENCE_MASS:
                put = partial(self._put, port)
                self.create_subscription(port.type, port.name, put, port.stage_qos, raw=True)
        if passes is not None:
            self.subscribe(ports.VERDICT, self._on_verdict)

    def write(self, bag: BagWriter) -> bool:
        """Write the next message into a bag; return whether one came in time.

        The bag is flushed once a second.
        """
        came = False
        with suppress(queue.Empty):
            bag.put(*self.messages.get(timeout=_POLL_PERIOD))
            came = True
        if time.monotonic() - self._flushed > _FLUSH_PERIOD:
            self._flushed = time.monotonic()
            bag.flush()
        return came

    def _put(self, port: Port, data: bytes) -> None:
        self.messages.put((port, time.time_ns(), data))

    def _on_verdict(self, verdict: Verdict) -> None:
        assert self.passes is not None
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
    """Record for a duration in s, until all passes have come, or until SIGINT, SIGTERM or SIGHUP.

    The bag has its name from the first message on. If this process is killed, the bag lacks the
    last second and ``metadata.yaml``. With `inputs_only`, results are not recorded, because a
    replay computes them again. The known mass of `passes` is recorded in place of the references of
    the line.

    Raises `OutputError` if the bag cannot be written; `UserError` if no message came, which leaves
    no bag.
    """
    recorded = ports.PLAYED if inputs_only else ports.RECORDED
    with (
        asked_to_end() as asked,
        BagWriter(path, recorded, namespace, in_place=True) as bag,
        spinning(namespace) as spinner,
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
                f'{path}: nothing was recorded: no message came on {topic}; is the line running?'
            )
    print(f'{path}: {count} messages' + (f', {passes.count} passes' if passes else ''))


def _write_until(end: float, bag: BagWriter, node: RecorderNode, asked: Sequence[int]) -> None:
    """Write messages until `end` in s, all passes have come, or a signal asks for the end."""
    finishing, passes = False, node.passes
    now = silent_since = time.monotonic()
    with tqdm(desc='recording', unit=' messages', disable=None, leave=False) as progress:
        while now < end and not (passes and passes.done):
            if asked and not finishing:
                finishing, end = True, min(end, now + _FAREWELL)
            for line in passes.lines() if passes else ():
                progress.write(line)
            if node.write(bag):
                progress.update()
                silent_since = now
            elif finishing:
                break
            elif now - silent_since > _PATIENCE:
                silent_since = now
                progress.write(f'no messages for {_PATIENCE:.0f} s')
            now = time.monotonic()
