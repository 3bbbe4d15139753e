# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recorder: the messages of a lane, byte for byte as they come, into a bag."""

from collections.abc import Sequence
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
_FLUSH_PERIOD = 1.0  # s; a recording lacks no more than that if the process is killed
_FAREWELL = 1.0  # s, for the messages that had come when the end was asked for
_PATIENCE = 5.0  # s without a message before that is reported
_TRAIL = 1.0  # s, in which the last product leaves the belt
# Passes with these reasons count: their window is whole, and training may remove the reason.
_OF_USE = {Reason.SPEED_NOT_TRAINED, Reason.NO_CONVERGENCE, Reason.NO_PRODUCT}


class ReferencePasses:
    """Passes of products of one known mass, kg; `wanted` of them end the recording.

    `count` passes have come up to now, without those that have no whole window. The queue `news`
    has a line for each pass and may be read from any thread.
    """

    def __init__(self, mass: float, wanted: int | None) -> None:
        self.news: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.count = 0
        self._mass = mass
        self._wanted = math.inf if wanted is None else wanted
        self._of = '' if wanted is None else f' of {wanted}'
        self._last = 0.0

    @property
    def done(self) -> bool:
        """Whether the wanted passes have come, and the last product has left the belt."""
        return self.count >= self._wanted and time.monotonic() > self._last + _TRAIL

    def take(self, verdict: Verdict) -> Reference | None:
        """Return the known mass of the item of a verdict, None if the pass does not count."""
        if self.count >= self._wanted:
            return None
        reasons = ', '.join(verdict.reasons)
        fault = verdict.decision == Decision.FAULT and not _OF_USE.issuperset(verdict.reasons)
        if fault or verdict.t1 is None:
            self.news.put(f'a pass that was not weighed: {reasons}')
            return None
        self.count += 1
        self._last = time.monotonic()
        found = f'{GRAMS * verdict.mass:.3f} g, {GRAMS * (verdict.mass - self._mass):+.3f} g'
        if math.isnan(verdict.mass):
            found = f'no mass yet: {reasons}'
        self.news.put(f'pass {self.count}{self._of}: {found}')
        return Reference(verdict.t1, self._mass)


class RecorderNode(PortNode):
    """Queue the serialized messages of a lane, with port and time of arrival in ns.

    The queue `messages` may be read from any thread. The known mass of `passes` takes the place of
    the references of the line.
    """

    def __init__(
        self, recorded: tuple[Port, ...], passes: ReferencePasses | None, name: str = 'record'
    ) -> None:  # fmt: skip
        super().__init__(name)
        self.messages: queue.Queue[tuple[Port, int, bytes]] = queue.Queue()
        self._passes = passes
        # With the profile of the stages, which takes no old verdicts: they would belong to items
        # that are not in the recording.
        for port in recorded:
            if passes is None or port is not ports.REFERENCE_MASS:
                put = partial(self._put, port)
                self.create_subscription(port.type, port.name, put, port.stage_qos, raw=True)
        if passes is not None:
            self.subscribe(ports.VERDICT, self._on_verdict)

    def _put(self, port: Port, data: bytes) -> None:
        self.messages.put((port, time.time_ns(), data))

    def _on_verdict(self, verdict: Verdict) -> None:
        assert self._passes is not None
        reference = self._passes.take(verdict)
        if reference is not None:
            message = to_message(ports.REFERENCE_MASS, reference)
            self._put(ports.REFERENCE_MASS, serialize_message(message))


def record(
    path: Path, namespace: str, duration: float | None, *, inputs_only: bool = False,
    reference: float | None = None, passes: int | None = None,
) -> None:  # fmt: skip
    """Record until the duration is over, the passes have come, or SIGINT, SIGTERM or SIGHUP comes.

    The bag grows under its name from the first message on. If this process is killed, it lacks the
    last second and ``metadata.yaml``. With `inputs_only` it has not what a replay makes again.
    `duration` is in s, `reference` is the known mass of every product that passes, kg: it goes into
    the bag as reference_mass, in place of the references of the line; `passes` of it are enough.

    An OutputError says that the bag cannot be written, a UserError that no message came: an empty
    bag is of no use, so none is left.
    """
    recorded = ports.PLAYED if inputs_only else ports.RECORDED
    known = None if reference is None else ReferencePasses(reference, passes)
    with (
        asked_to_end() as asked,
        BagWriter(path, recorded, namespace, in_place=True) as bag,
        spinning(namespace) as spinner,
    ):
        node = RecorderNode(recorded, known)
        spinner.add(node)
        _take(bag, node, duration, known, asked)
        while not node.messages.empty():
            bag.put(*node.messages.get())
        count = bag.message_count
        if count == 0:
            topic = node.resolve_topic_name(ports.LOAD_CELL_SAMPLES.name)
            text = f'nothing was recorded: no message came on {topic}; is the line running?'
            raise UserError(f'{path}: {text}')
    print(f'{path}: {count} messages' + (f', {known.count} passes' if known else ''))


def _take(
    bag: BagWriter, node: RecorderNode, duration: float | None, known: ReferencePasses | None,
    asked: Sequence[int],
) -> None:  # fmt: skip
    """Write messages until the end, and those that had come when it was asked for."""
    finishing = False
    now = silent_since = flushed = time.monotonic()
    end = math.inf if duration is None else now + duration
    with tqdm(desc='recording', unit=' messages', disable=None, leave=False) as progress:
        while now < end and not (known and known.done):
            if asked and not finishing:
                finishing, end = True, min(end, now + _FAREWELL)
            while known and not known.news.empty():
                progress.write(one_line(known.news.get()))
            try:
                message = node.messages.get(timeout=_POLL_PERIOD)
            except queue.Empty:
                if finishing:
                    break
                if now - silent_since > _PATIENCE:
                    silent_since = now
                    progress.write(f'no messages for {_PATIENCE:.0f} s')
            else:
                bag.put(*message)
                progress.update()
                silent_since = now
            now = time.monotonic()
            if now - flushed > _FLUSH_PERIOD:
                flushed = now
                bag.flush()
