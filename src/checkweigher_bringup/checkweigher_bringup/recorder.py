"""The recorder: the messages of a lane, byte for byte as they come, into a bag."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import math
from pathlib import Path
import queue
import signal
import time
from types import FrameType
from typing import Any

from rclpy.node import Node
from rclpy.serialization import serialize_message
from tqdm import tqdm

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import spinning
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import Decision, Reference
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import reference_to, verdict_from
from checkweigher_dsp.ros.ports import Port
from checkweigher_recording.bags.writing import BagWriter
from checkweigher_validation.accuracy.results import GRAMS

_POLL_PERIOD = 0.2  # s
_FLUSH_PERIOD = 1.0  # s; what is lost of a recording if the process is killed
_FAREWELL = 1.0  # s, for what had come when the end was asked for
_PATIENCE = 5.0  # s without a message before that is said
_TRAIL = 1.0  # s, in which the last product leaves the belt
# Passes with these reasons count: their window is whole, and the dynamic setting removes the first.
_OF_USE = {Reason.SPEED_NOT_TRAINED, Reason.NO_CONVERGENCE, Reason.NO_PRODUCT}


class RecorderNode(Node):
    """Queue the serialized messages of a lane.

    Attributes
    ----------
    messages : queue of (Port, int, bytes)
        Port, time of arrival in ns and message; read from any thread.
    """

    def __init__(self, recorded: tuple[Port, ...]) -> None:
        super().__init__('record')
        self.messages: queue.SimpleQueue[tuple[Port, int, bytes]] = queue.SimpleQueue()
        for port in recorded:
            # As the stages do, which ask for no old verdicts: these would belong to items that are
            # not in the recording.
            self.create_subscription(
                port.type, port.name, self.taker(port), port.stage_qos, raw=True
            )

    def taker(self, port: Port) -> Callable[[bytes], None]:
        """Return a callback that queues serialized messages of a port."""

        def take(data: bytes) -> None:
            self.messages.put((port, time.time_ns(), data))

        return take


class ReferencePasses:
    """Say of every item that passed as a whole what it weighs.

    Parameters
    ----------
    mass : float
        kg.
    wanted : int, optional
        Passes after which that is enough.

    Attributes
    ----------
    count : int
        Passes up to now; those of which there is no whole window do not count and get no mass.
    """

    def __init__(self, mass: float, wanted: int | None) -> None:
        self._mass = mass
        self._wanted = wanted
        self._news: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._last = 0.0
        self.count = 0

    @property
    def done(self) -> bool:
        """Whether there were enough, and the last one has left the belt."""
        return (
            self._wanted is not None
            and self.count >= self._wanted
            and time.monotonic() > self._last + _TRAIL
        )

    def attach(self, node: Node, put: Callable[[bytes], None]) -> None:
        """Listen with a node, and hand over serialized messages of reference_mass."""

        def hear(message: Any) -> None:
            verdict = verdict_from(message)
            if self._wanted is not None and self.count >= self._wanted:
                return
            fault = verdict.decision == Decision.FAULT and not _OF_USE.issuperset(verdict.reasons)
            if fault or verdict.t1 is None:
                self._news.put(f'a pass that was not weighed: {", ".join(verdict.reasons)}')
                return
            put(serialize_message(reference_to(Reference(verdict.t1, self._mass))))
            self.count += 1
            self._last = time.monotonic()
            of = '' if self._wanted is None else f' of {self._wanted}'
            found = (
                f'{GRAMS * verdict.mass:.3f} g, {GRAMS * (verdict.mass - self._mass):+.3f} g'
                if verdict.mass == verdict.mass
                else f'no mass yet: {", ".join(verdict.reasons)}'
            )
            self._news.put(f'pass {self.count}{of}: {found}')

        node.create_subscription(
            ports.VERDICT.type, ports.VERDICT.name, hear, ports.VERDICT.stage_qos
        )

    def news(self) -> list[str]:
        """Return a line for each pass since the last call."""
        lines = []
        while not self._news.empty():
            lines.append(self._news.get())
        return lines


def record(
    path: Path,
    namespace: str,
    duration: float | None,
    *,
    inputs_only: bool = False,
    reference: float | None = None,
    passes: int | None = None,
) -> int:
    """Record until the duration is over or SIGINT or SIGTERM comes; return the exit status.

    The bag grows under its name from the first message on. If this process is killed, it lacks the
    last second and ``metadata.yaml``.

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
    reference : float, optional
        kg, known mass of every product that passes: it goes into the bag as reference_mass, in
        place of what the line itself may say.
    passes : int, optional
        Weighed passes of it after which to end.

    Raises
    ------
    OutputError
        If the bag cannot be written.
    UserError
        If no message came: an empty bag is of no use, so none is left.
    """
    recorded = ports.PLAYED if inputs_only else ports.ALL

    with (
        _signals_restored(),
        BagWriter(path, recorded, namespace, in_place=True) as bag,
        spinning(namespace) as spinner,
    ):
        known = None if reference is None else ReferencePasses(reference, passes)
        node = RecorderNode(
            tuple(port for port in recorded if not (known and port is ports.REFERENCE_MASS))
        )
        spinner.add(node)
        if known is not None:
            known.attach(node, node.taker(ports.REFERENCE_MASS))
        _take(bag, node, duration, known)
        while not node.messages.empty():
            bag.put(*node.messages.get())
        if bag.message_count == 0:
            raise UserError(
                f'{path}: nothing was recorded: no message came on '
                f'{node.resolve_topic_name(ports.LOAD_CELL_SAMPLES.name)}; is the line running?'
            )
        count = bag.message_count
    print(f'{path}: {count} messages' + (f', {known.count} passes' if known else ''))
    return 0


@contextmanager
def _signals_restored() -> Iterator[None]:
    """Leave SIGINT and SIGTERM, in the end, to whoever had them before."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


class _Ending:
    """Whether SIGINT or SIGTERM has come; it must not break into the writing of a message."""

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True


def _take(
    bag: BagWriter, node: RecorderNode, duration: float | None, known: ReferencePasses | None
) -> None:
    ending = _Ending()
    asked = False
    now = silent_since = flushed = time.monotonic()
    end = math.inf if duration is None else now + duration
    with tqdm(desc='recording', unit=' messages', disable=None, leave=False) as progress:
        while now < end and not (known and known.done):
            if ending.asked and not asked:
                asked, end = True, min(end, now + _FAREWELL)
            for line in known.news() if known else ():
                progress.write(line)
            try:
                message = node.messages.get(timeout=_POLL_PERIOD)
            except queue.Empty:
                if asked:
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
