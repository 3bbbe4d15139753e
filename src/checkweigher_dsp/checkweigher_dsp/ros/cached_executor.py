"""An executor that keeps its wait set from one wait to the next."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
import inspect
import math
import time
from typing import Any, TypeVar, cast

from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    ShutdownException,
    TimeoutException,
    TimeoutObject,
)
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.waitable import NumberOfEntities, Waitable

from checkweigher_dsp.ros.delivery import Delivery, is_handed_over, was_handed_over
from checkweigher_dsp.ros.executor import DeliveringExecutor

_LOOK_PERIOD = 0.05  # s, in which services and clients are looked at under traffic
_CLEAR_PERIOD = 1.0  # s, for events, and subscriptions of which all is handed over
_CLEAR_EARLY = 0.6  # s, from which on that is done when the process is awake for a timer anyway
_LIVELY = 0.5  # s after a call in which the next one is expected
_LONGEST_SWEEP = 0.02  # s of messages after which timers get their turn
_ROUNDS = 4  # after which subscriptions without messages are asked again
_INTERNALS = ('_guard', '_sigint_gc', '_tasks', '_context', '_is_shutdown', '_spin_once_impl')
_RARE_KINDS = ('subscription', 'client', 'service')

WaitSet = _rclpy.WaitSet
T = TypeVar('T')
# How an entity is added to a wait set, the entity, its handle.
Listed = tuple[Any, Any, Any]


class CachedExecutor(DeliveringExecutor):
    """A single-threaded executor that keeps its wait set from one wait to the next.

    That of rclpy collects all entities of all nodes anew before each wait, and waits twice for
    each callback: 2.4 ms for the six nodes of a line, most of it for services that nobody calls.
    Here the entities are collected when one was created or destroyed. After a callback all
    subscriptions are asked at once, for within a process a message has arrived when publishing it
    returns. What is rare (services, clients, events, coroutines, tasks) is only found here and
    then done in the way of rclpy, so that it does what it does there.
    """

    def __init__(self, delivery: Delivery, **options: Any) -> None:
        self._stale = True
        self._in_use = ExitStack()
        self._subscriptions: list[Subscription] = []
        self._seldom: list[Subscription] = []  # all of theirs is handed over
        self._timers: list[Timer] = []
        self._guards: list[GuardCondition] = []
        self._frequent: list[Listed] = []
        self._rare: list[Listed] = []
        self._rare_pointers: set[int] = set()
        self._events: list[Waitable] = []  # of the middleware
        self._waitables: list[Waitable] = []  # all others
        self._watched: list[Waitable] = []  # those that the last wait was for
        self._is_ordinary = True
        self._spinning = False
        self._frequent_set: Any = None
        self._whole_set: Any = None
        self._event_set: Any = None
        # When, s of the monotonic clock.
        self._looked = self._called = self._swept = self._cleared = -math.inf
        super().__init__(delivery, **options)
        for name in _INTERNALS:
            getattr(self, name)  # AttributeError with an rclpy that has become another one

    def add_node(self, node: Node) -> bool:
        """Serve one more node."""
        self._stale = True
        # Its timers come first: what reaches a node that is not active yet is lost.
        self._cleared = time.monotonic()
        return bool(super().add_node(node))

    def remove_node(self, node: Node) -> None:
        """Serve a node no longer."""
        self._stale = True
        super().remove_node(node)

    def wake(self) -> None:
        """Collect the entities anew: one was created or destroyed."""
        self._stale = True
        super().wake()

    def nudge(self) -> None:
        """Have a wait end, from any thread."""
        if self._guard is not None:
            self._guard.trigger()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop for good. The thread that spins lets go of the entities, if there is one."""
        if not self._spinning:
            self._let_go()
        return bool(super().shutdown(timeout_sec))

    def _spin_once_impl(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        wait_condition: Callable[[], bool] = lambda: False,
    ) -> None:
        """Wait for something, do it and what came of it meanwhile."""
        seconds = timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec
        end = math.inf if seconds is None or seconds < 0 else time.monotonic() + seconds
        self._spinning = True
        try:
            while not self._is_shutdown and not wait_condition():
                if self._stale:
                    self._collect()
                if not self._is_ordinary:
                    super()._spin_once_impl(timeout_sec, wait_condition)
                    return
                if self._has_tasks() and self._do_the_rare():
                    return
                if self._serve(end) or time.monotonic() >= end:
                    return
        finally:
            self._spinning = False
            if self._is_shutdown:
                self._let_go()

    def _has_tasks(self) -> bool:
        """Tell whether a coroutine or a task waits."""
        return any(not task.done() for task, _, _ in self._tasks)

    def _do_the_rare(self) -> bool:
        """Do once what is ready, in the way of rclpy; return whether anything was finished."""
        finished = False
        try:
            while True:
                # The same arguments each time: with others rclpy begins a new round, in which
                # what comes late in a round never gets its turn.
                handler, _, _ = self.wait_for_ready_callbacks(0.0, None, _never)
                handler()
                if handler.exception() is not None:
                    raise handler.exception()
                finished |= handler.done()
        except (ShutdownException, TimeoutException, ConditionReachedException):
            return finished

    def _serve(self, end: float) -> bool:
        """Wait until `end`, s of the monotonic clock; return whether anything was done."""
        now = time.monotonic()
        clears = bool(self._seldom or self._events)
        if clears:
            if now >= self._cleared + _CLEAR_PERIOD:
                return self._clear_away()
            end = min(end, self._cleared + _CLEAR_PERIOD)
        look = self._looked + _LOOK_PERIOD
        # Without messages one wait for everything costs less than one for them and one for all.
        quiet = now > self._swept + _LOOK_PERIOD
        whole = quiet or now >= look or now < self._called + _LIVELY
        wait_set = self._wait_set(whole=whole)
        until = end if whole else min(end, look)
        with self._delivery.away():
            wait_set.wait(-1 if until == math.inf else max(0, round(1e9 * (until - now))))
        if whole:
            self._looked = time.monotonic()
        if not self._context.ok():
            raise ExternalShutdownException()
        timers = set(wait_set.get_ready_entities('timer'))
        called = whole and self._is_called(wait_set, timers)
        messages = set(wait_set.get_ready_entities('subscription'))
        done = bool(timers) and self._call_timers(timers)
        if messages:
            self._sweep(messages)
            done = True
        if called:
            self._called = time.monotonic()
            done |= self._do_the_rare()
        early = clears and bool(timers) and not self._stale
        if early and time.monotonic() >= self._cleared + _CLEAR_EARLY:
            done |= self._clear_away()
        return done

    def _clear_away(self) -> bool:
        """Take what DDS has brought of what was handed over, and what came from outside with it."""
        self._cleared = time.monotonic()
        with self._delivery.away():
            came = list(self._leftovers())
        if came:  # what was published before on other topics comes first
            self._sweep({each.handle.pointer for each in self._subscriptions})
        for subscription, *arguments in came:
            self._execute(subscription, subscription.callback, *arguments)
        self._delivery.look()
        return self._has_event() and self._do_the_rare()

    def _has_event(self) -> bool:
        """Tell whether there is an event of the middleware."""
        wait_set = self._event_set
        wait_set.clear_entities()
        for event in self._events:
            event.add_to_wait_set(wait_set)
        wait_set.wait(0)
        return any(event.is_ready(wait_set) for event in self._events)

    def _leftovers(self) -> Iterator[tuple[Subscription, Any, Any]]:
        """Yield what DDS has brought that was not handed over, and take what was."""
        for subscription in self._seldom:
            for _ in range(subscription.qos_profile.depth):
                # Serialized, for hardly any of it is looked at.
                taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                message, info = taken
                if was_handed_over(subscription, info):
                    continue
                if not subscription.raw:
                    message = deserialize_message(message, subscription.msg_type)
                yield subscription, message, info

    def _collect(self) -> None:
        """List the entities of all nodes, and keep them from being destroyed while listed."""
        self._let_go()
        self._stale = False  # before the look: what comes during it is found by the next one
        nodes = self.get_nodes()
        self._is_ordinary = not any(True for node in nodes for _ in node.guards)
        self._guards = self._held([self._guard, self._sigint_gc])
        for node in nodes:
            subscriptions, timers = self._held(node.subscriptions), self._held(node.timers)
            seldom = [each for each in subscriptions if is_handed_over(each)]
            subscriptions = [each for each in subscriptions if each not in seldom]
            self._seldom += seldom
            self._subscriptions += [each for each in subscriptions if _is_plain(each)]
            self._timers += [each for each in timers if _is_plain(each)]
            # Of these there are dozens, and they come when an endpoint is found, if ever.
            waitables = self._held(node.waitables)
            self._events += [each for each in waitables if isinstance(each, EventHandler)]
            self._waitables += [each for each in waitables if not isinstance(each, EventHandler)]
            for subscription in subscriptions:
                self._list(WaitSet.add_subscription, subscription)
            for timer in timers:
                self._list(WaitSet.add_timer, timer)
            for client in self._held(node.clients):
                self._list(WaitSet.add_client, client)
            for service in self._held(node.services):
                self._list(WaitSet.add_service, service)
        self._rare_pointers = {handle.pointer for _, _, handle in self._rare}
        guards = NumberOfEntities(num_gcs=len(self._guards))
        self._frequent_set = self._new_wait_set(guards + _count(self._frequent))
        whole = guards + _count([*self._frequent, *self._rare]) + _count_in(self._waitables)
        self._whole_set = self._new_wait_set(whole)
        self._event_set = self._new_wait_set(_count_in(self._events))

    def _list(self, add: Any, entity: Any) -> None:
        frequent = isinstance(entity, Subscription | Timer) and _is_plain(entity)
        (self._frequent if frequent else self._rare).append((add, entity, entity.handle))

    def _held(self, entities: Iterable[T]) -> list[T]:
        held = []
        for entity in entities:
            try:
                handle: Any = entity if isinstance(entity, Waitable) else cast(Any, entity).handle
                self._in_use.enter_context(handle)
            except InvalidHandle:  # destroyed meanwhile
                continue
            held.append(entity)
        return held

    def _let_go(self) -> None:
        """Forget the entities: what was destroyed meanwhile goes now."""
        self._frequent_set = self._whole_set = self._event_set = None
        self._subscriptions, self._timers, self._waitables = [], [], []
        self._seldom, self._events = [], []
        self._frequent, self._rare = [], []
        self._watched, self._guards = [], []
        self._in_use.close()
        self._stale = True

    def _new_wait_set(self, count: NumberOfEntities) -> Any:
        return WaitSet(
            count.num_subscriptions, count.num_guard_conditions, count.num_timers,
            count.num_clients, count.num_services, count.num_events, self._context.handle,
        )  # fmt: skip

    def _wait_set(self, *, whole: bool) -> Any:
        """Return a wait set that is ready to wait; waiting empties it."""
        wait_set = self._whole_set if whole else self._frequent_set
        wait_set.clear_entities()
        listed = [*self._frequent, *self._rare] if whole else self._frequent
        waitables = self._waitables if whole else []
        if self._has_tasks():  # only then can a callback group be taken
            listed = [each for each in listed if self.can_execute(each[1])]
            waitables = [each for each in waitables if self.can_execute(each)]
        for add, _, handle in listed:
            add(wait_set, handle)
        for guard in self._guards:
            wait_set.add_guard_condition(guard.handle)
        for waitable in waitables:
            waitable.add_to_wait_set(wait_set)
        self._watched = waitables
        return wait_set

    def _is_called(self, wait_set: Any, timers: set[int]) -> bool:
        """Tell whether anything rare is ready."""
        ready = timers.union(*map(wait_set.get_ready_entities, _RARE_KINDS))
        return not self._rare_pointers.isdisjoint(ready) or any(
            waitable.is_ready(wait_set) for waitable in self._watched
        )

    def _call_timers(self, ready: set[int]) -> bool:
        done = False
        for timer in self._timers:
            if self._stale:
                break  # one of them may have been destroyed
            # Cancelled by the one before, it is none; rcl tells of cancelled ones, too.
            if timer.handle.pointer in ready and timer.handle.is_timer_ready():
                timer.handle.call_timer()
                self._execute(timer, timer.callback)
                done = True
        return done

    def _sweep(self, ready: set[int]) -> None:
        """Take messages in rounds, one of each subscription, until there are none.

        A round is of the subscriptions that had one in the round before, and of all of them now
        and then.
        """
        self._swept = time.monotonic()
        end = self._swept + _LONGEST_SWEEP
        asked = [each for each in self._subscriptions if each.handle.pointer in ready]
        rounds = 0
        while asked and time.monotonic() < end:
            rounds += 1
            busy = self._has_tasks()
            had = []
            for subscription in asked:
                if busy and not self.can_execute(subscription):
                    continue
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                if taken is None:
                    continue
                had.append(subscription)
                arguments = taken[:1] if _takes_message_alone(subscription) else taken
                self._execute(subscription, subscription.callback, *arguments)
                if self._stale or self._is_shutdown:
                    return
            asked = had
            if had and rounds % _ROUNDS == 0:
                asked = self._subscriptions

    def _execute(self, entity: Any, callback: Callable[..., Any], *arguments: Any) -> None:
        group = entity.callback_group
        group.beginning_execution(entity)
        try:
            callback(*arguments)
        finally:
            group.ending_execution(entity)
        self._delivery.catch_up()  # a product on the belt does not wait for the next timer


def _never() -> bool:
    return False


def _is_plain(entity: Subscription | Timer) -> bool:
    """Tell whether the callback of an entity is a function."""
    return not inspect.iscoroutinefunction(entity.callback)


def _takes_message_alone(subscription: Subscription) -> bool:
    # rclpy has no other word for what a callback takes.
    return subscription._callback_type is Subscription.CallbackType.MessageOnly


def _count(listed: Iterable[Listed]) -> NumberOfEntities:
    counts = Counter(type(entity) for _, entity, _ in listed)
    return NumberOfEntities(
        num_subs=counts[Subscription], num_timers=counts[Timer],
        num_clients=counts[Client], num_services=counts[Service],
    )  # fmt: skip


def _count_in(waitables: Iterable[Waitable]) -> NumberOfEntities:
    return sum((each.get_num_entities() for each in waitables), NumberOfEntities())
