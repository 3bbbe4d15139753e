"""Messages between the nodes of one process, handed over as they are instead of over DDS.

rclcpp has this as intra-process communication, rclpy has not. What is published still goes over
DDS to whoever listens outside, and the endpoints are in the graph as ever.
"""

from array import array
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import math
import threading
import time
from typing import Any, Protocol

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier

from checkweigher_dsp.ros.ports import fits

_LONGEST_WAIT = 0.005  # s for a turn, after which a source leaves what it has to whoever waits
_LONGEST_TURN = 0.01  # s of messages, after which the executor looks at timers and services
_REMEMBERED = 1000  # messages sent over DDS, beyond those that a queue holds
_MAX_GONE = 10  # publishers that were destroyed, whose messages may yet come over DDS
_ROUNDING = 1000  # ns, of the time stamps of DDS
# Others do not number what they send, by which a copy is told from what comes from outside.
_NUMBERING = ('rmw_fastrtps_cpp', 'rmw_fastrtps_dynamic_cpp')


class Server(Protocol):
    """The executor of the process, as far as it is known here."""

    def nudge(self) -> None:
        """Have a wait end, from any thread."""

    def wake(self) -> None:
        """Have a wait end and collect anew what is waited for, from any thread."""

    def create_task(self, callback: Callable[..., Any], *args: Any) -> Any:
        """Call something in the thread that spins."""


class DeliveringPublisher(Publisher):
    """A publisher that hands its messages to the subscriptions of its process."""

    _delivery: 'Delivery | None' = None

    def join(self, delivery: 'Delivery') -> None:
        """Publish through `delivery` from now on."""
        self.takers: tuple[_Taker, ...] = ()
        self.name = self.topic_name
        self.has_published = False
        self.order = threading.Lock()
        self._is_kept = self.qos_profile.durability != DurabilityPolicy.VOLATILE
        # When what was sent over DDS was handed to it, by the number that DDS gives it.
        size = self.qos_profile.depth + _REMEMBERED
        self._sent = 0
        self._began, self._ended = array('q', bytes(8 * size)), array('q', bytes(8 * size))
        self._delivery = delivery

    def publish(self, msg: Any) -> None:
        """Publish a message; whoever receives it in this process must not change it."""
        delivery = self._delivery
        if delivery is None:
            super().publish(msg)
            return
        if not isinstance(msg, self.msg_type):
            raise TypeError(f'{self.name}: expected {self.msg_type}, got {type(msg)}')
        with self.order:
            self.has_published = True
            takers = self.takers
            # Where results are kept for those who come later, DDS has to have them.
            if self._is_kept or self.get_subscription_count() != len(takers):
                self._send(msg)
            delivery.post(takers, msg)
        if takers:
            delivery.serve()

    def _send(self, msg: Any) -> None:
        at = (self._sent + 1) % len(self._began)
        self._began[at], self._ended[at] = time.time_ns(), 2**63 - 1
        self._sent += 1
        super().publish(msg)
        self._ended[at] = time.time_ns()

    def has_sent(self, info: dict[str, Any]) -> bool:
        """Tell whether a message that came over DDS is one that was sent here."""
        number = int(info['publication_sequence_number'] or 0)
        if not 0 < number <= self._sent:
            return False
        at = number % len(self._began)
        begin, end = self._began[at] - _ROUNDING, min(self._ended[at], 2**62) + _ROUNDING
        return begin <= int(info['source_timestamp']) <= end


class _Taker:
    """A subscription of the process."""

    subscription: Subscription | None = None

    def __init__(self, node: Node, callback: Callable[[Any], None]) -> None:
        self.node = node
        self.callback = callback
        self.name = ''
        self.open = False
        self.makers: list[DeliveringPublisher] = []  # whose messages are handed over
        self._gone: deque[DeliveringPublisher] = deque(maxlen=_MAX_GONE)  # those before
        self.listens = True  # whether something may come over DDS that is not handed over

    def has_had(self, info: Any) -> bool:
        """Tell whether a message that came over DDS was handed over as well."""
        return any(maker.has_sent(info) for maker in (*self.makers, *self._gone))

    def take(self, message: Any, info: Any) -> None:
        """Take a message from DDS, unless it was handed over."""
        if not self.has_had(info):
            self.callback(message)

    def join(self, maker: DeliveringPublisher) -> None:
        """Have the messages of a publisher handed over, if it has published nothing yet."""
        if not _fit(maker, self):
            return
        with maker.order:
            if maker.has_published:
                return
            self.makers.append(maker)
            maker.takers += (self,)

    def leave(self, maker: DeliveringPublisher) -> None:
        """Have nothing more of a publisher."""
        self.makers.remove(maker)
        self._gone.append(maker)
        with maker.order:
            maker.takers = tuple(taker for taker in maker.takers if taker is not self)

    def look(self) -> bool:
        """Find out whether somebody else publishes there; return whether that has changed."""
        assert self.subscription is not None
        known = self.listens
        count = self.subscription.get_publisher_count()
        # Where nobody of this process publishes, who comes from outside must not be kept waiting.
        self.listens = not self.open or not self.makers or count > len(self.makers)
        return self.listens != known


class Delivery:
    """Hands messages over between the nodes of a process, one at a time, in order.

    Whoever publishes calls the callbacks itself: they run in the thread of the executor or in that
    of a source, but never two at once, for both take turns. What is published in a callback comes
    after it. A subscription gets handed over what publishers publish that had published nothing
    before it was there; from all others it has it over DDS.
    """

    def __init__(self) -> None:
        self._queue: deque[tuple[_Taker, Any]] = deque()
        self._turn = threading.Lock()
        self._waiting_since = math.inf  # s of the monotonic clock, where somebody waits for a turn
        self._away = False  # whether the executor waits for something to do
        self._executor: Server | None = None
        self._change = threading.Lock()  # of what follows
        self._makers: defaultdict[str, list[DeliveringPublisher]] = defaultdict(list)
        self._takers: defaultdict[str, list[_Taker]] = defaultdict(list)

    # What there is

    def add_publisher(self, publisher: DeliveringPublisher) -> None:
        """Take in a publisher that has published nothing yet."""
        publisher.join(self)
        with self._change:
            self._makers[publisher.name].append(publisher)
            for taker in self._takers[publisher.name]:
                if taker.open:
                    taker.join(publisher)
        self.look()

    def subscribe(
        self,
        node: Node,
        message: Any,
        name: str,
        callback: Callable[[Any], None],
        qos: QoSProfile,
        events: SubscriptionEventCallbacks | None = None,
    ) -> Subscription:
        """Subscribe to a topic; it is handed over from the time that an executor has the node."""
        taker = _Taker(node, callback)
        subscription = node.create_subscription(
            message, name, taker.take, qos, event_callbacks=events
        )
        taker.subscription, taker.name = subscription, subscription.topic_name
        with self._change:
            self._takers[taker.name].append(taker)
        return subscription

    def open(self, node: Node) -> None:
        """Begin to hand over to a node: an executor has it."""
        with self._change:
            for taker in self._takers_of(node):
                taker.open = True
                for maker in self._makers[taker.name]:
                    taker.join(maker)
        self.look()

    def close(self, node: Node) -> None:
        """Hand nothing more over to a node."""
        with self._change:
            for taker in self._takers_of(node):
                self._close(taker)
        self.look()

    def look(self) -> None:
        """Find out which subscriptions have to be taken from DDS, for somebody else publishes."""
        with self._change:
            takers = [taker for each in self._takers.values() for taker in each]
            # All of them: each has to look.
            changed = any([taker.look() for taker in takers])
        if changed and self._executor is not None:
            self._executor.wake()

    def forget(self, end: Subscription | Publisher) -> None:
        """Let go of one end of a topic: it is about to be destroyed."""
        with self._change:
            for makers in self._makers.values():
                for maker in [maker for maker in makers if maker is end]:
                    makers.remove(maker)
                    for taker in maker.takers:
                        taker.leave(maker)
            for takers in self._takers.values():
                for taker in [taker for taker in takers if taker.subscription is end]:
                    takers.remove(taker)
                    self._close(taker)

    def _takers_of(self, node: Node) -> list[_Taker]:
        return [taker for each in self._takers.values() for taker in each if taker.node is node]

    def _close(self, taker: _Taker) -> None:
        taker.open = False
        for maker in list(taker.makers):
            taker.leave(maker)

    # Handing over

    def post(self, takers: tuple[_Taker, ...], message: Any) -> None:
        """Put a message down for subscriptions."""
        for taker in takers:
            self._queue.append((taker, message))

    def serve(self) -> None:
        """Hand over what there is, unless somebody else is at it, who then does it."""
        while (
            self._queue
            and time.monotonic() < self._waiting_since + _LONGEST_WAIT
            and self._turn.acquire(blocking=False)
        ):
            try:
                done = self._hand_over()
            except Exception as error:
                # Not the fault of whoever happened to publish: it ends the spin, as always.
                if self._executor is None:
                    raise
                self._executor.create_task(_raise, error)
                return
            finally:
                self._turn.release()
            if not done:
                self.nudge()
                return

    def _hand_over(self) -> bool:
        """Call the callbacks; return whether there is nothing left."""
        end = time.monotonic() + _LONGEST_TURN
        while self._queue:
            taker, message = self._queue.popleft()
            if taker.open:
                taker.callback(message)
            if time.monotonic() > end:
                return not self._queue
        return True

    # Turns

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Wait until nobody is in a callback, and keep it so; then hand over what came of it."""
        self._begin()
        try:
            yield
        finally:
            self._end()

    @contextmanager
    def away(self) -> Iterator[None]:
        """Leave the turn to others, for as long as the executor waits."""
        self._end()
        self._away = True
        # Whoever came too late for a turn that was about to end has left something.
        if self._queue:
            self.nudge()
        try:
            yield
        finally:
            self._away = False
            self._begin()
            self.catch_up()

    def catch_up(self) -> None:
        """Hand over, in the middle of a turn, what others have left to whoever has it."""
        if self._queue:
            self._hand_over()

    def _begin(self) -> None:
        self._waiting_since = time.monotonic()
        self._turn.acquire()
        self._waiting_since = math.inf

    def _end(self) -> None:
        try:
            self._hand_over()
        finally:
            self._turn.release()

    # The executor

    def attach(self, executor: Server | None) -> None:
        """Name the executor that serves the nodes."""
        self._executor = executor

    def nudge(self) -> None:
        """Have the executor look at timers and messages if it waits: something has changed."""
        if self._away and self._executor is not None:
            self._executor.nudge()


def _raise(error: Exception) -> None:
    raise error


def is_handed_over(subscription: Subscription) -> bool:
    """Tell whether all that a subscription gets is handed over, and nothing has to be taken."""
    taker = _taker_of(subscription)
    return taker is not None and not taker.listens


def was_handed_over(subscription: Subscription, info: Any) -> bool:
    """Tell whether what came over DDS was handed over as well."""
    taker = _taker_of(subscription)
    return taker is not None and taker.has_had(info)


def _taker_of(subscription: Subscription) -> _Taker | None:
    taker = getattr(subscription.callback, '__self__', None)
    return taker if isinstance(taker, _Taker) else None


def _fit(maker: DeliveringPublisher, taker: _Taker) -> bool:
    assert taker.subscription is not None
    subscription = taker.subscription
    same = maker.msg_type is subscription.msg_type
    return same and fits(maker.qos_profile, subscription.qos_profile)


_current: Delivery | None = None


def current() -> Delivery | None:
    """Return what the nodes of this process are to use, None if all goes over DDS."""
    return _current


@contextmanager
def delivering() -> Iterator[Delivery]:
    """Have nodes that are made in the block hand their messages over."""
    global _current
    delivery = Delivery()
    if get_rmw_implementation_identifier() in _NUMBERING:
        _current = delivery
    try:
        yield delivery
    finally:
        _current = None
