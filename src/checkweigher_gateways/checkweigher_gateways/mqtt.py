# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gateway that publishes verdicts and lane states by MQTT, as JSON and Sparkplug B."""

import asyncio
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict
from functools import cached_property, partial
import json
import math
from pathlib import Path
import queue
import socket
import ssl
import time
from typing import Any, ClassVar

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from checkweigher_core.changes import plain
from checkweigher_core.health.findings import Finding, conclude, error_if, warn_if
from checkweigher_core.printable import one_line
from checkweigher_core.records import NANOSECONDS, Decision, Verdict, utc
from checkweigher_core.state_files import state_file
from checkweigher_gateways.gateway import Gateway, GatewayError
from checkweigher_gateways.lane_state import LaneState, LaneStates
from checkweigher_gateways.listening import Taken
from checkweigher_gateways.settings import GatewaySettings, MqttSettings
from checkweigher_gateways.sparkplug import NUMBERS, REBIRTH, EdgeNode, decode, element
from checkweigher_gateways.store import Store
from checkweigher_web.work.actions import new_batch, select_product, zero
from checkweigher_web.work.services import Person, Workshop

_KEEPALIVE = 10  # keep-alive interval of the connection in s
_RETRY = 1.0  # delay in s before the next attempt to connect
_WINDOW = 100  # largest number of published items that the broker has not confirmed yet
_FAREWELL = 1.0  # longest wait in s until the broker confirms the death message
_MARK_PATIENCE = 1.0  # longest wait in s for the retained message `delivered`
_MILLISECOND = NANOSECONDS // 1000
# Verdict in the birth message of a lane from which no verdict has been received yet.
_NOTHING = Verdict(0, None, Decision.FAULT)
_COMMANDS = 'Command/Product', 'Command/Batch', 'Command/Zero'


class MqttGateway(Gateway):
    """MQTT gateway. Verdicts wait on the disk while the broker cannot be reached.

    The threads of paho only put events into a queue. Each connection has its own client, because
    the Sparkplug will of each connection contains a different number, bdSeq. An item is stored
    before it is published, and marked as sent when the broker has confirmed it. The retained
    message ``delivered`` (the mark) contains the identity of the store, and the number of the last
    item that the broker has received.
    """

    kept: ClassVar[bool] = True

    def __init__(self, settings: MqttSettings) -> None:
        self._settings = settings
        self._states = LaneStates()
        self._events: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self._client: Client | None = None
        self._edge: EdgeNode | None = None
        # Whether the broker may have received the will of the edge node. If `_asked` is true, the
        # next connection needs an edge node with a new bdSeq.
        self._asked = False
        self._password: str | None = None
        self._trouble = 'not connected yet'
        self._retry_at = 0.0  # monotonic time in s of the next attempt to connect.
        # Monotonic time in s from which items may be sent, infinite without a connection.
        self._ready_at = math.inf
        self._born = 0  # time in ns since 1970 of the latest birth message, 0 before the first
        self._sent = 0
        self._confirmations: dict[int, int] = {}
        self._shown: dict[str, dict[str, object]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._node = settings.node or socket.gethostname()
        self._root = f'{settings.prefix}/{element(self._node)}'
        self._mark = f'{self._root}/delivered'

    async def start(self) -> str:
        """Open the store, and connect to the broker in the background.

        Returns the URL of the broker with the first levels of the topics. Raises `GatewayError` if
        the store, the certificates or the password file cannot be used.
        """
        its = self._settings
        path = Path(its.store) if its.store else state_file(f'gateway_mqtt.{self._node}.sqlite')
        try:
            self._store = Store(path, its.limit)
        except Exception as error:
            raise GatewayError(f'mqtt: {path}: {one_line(error)}') from None
        try:
            self._tls = self._context()
            if its.password_file:
                self._password = Path(its.password_file).read_text(encoding='utf-8').strip()
        except Exception as error:
            what = 'authority, certificate, key or password_file'
            raise GatewayError(f'mqtt: {what}: {one_line(error)}') from None
        self._connect()
        return f'mqtt{"s" * (self._tls is not None)}://{its.host}:{its.port}/{self._root}'

    def _context(self) -> ssl.SSLContext | None:
        its = self._settings
        if not its.authority:
            return None
        context = ssl.create_default_context(cafile=its.authority)
        if its.certificate:
            context.load_cert_chain(its.certificate, its.key or None)
        return context

    def _connect(self) -> None:
        its, put = self._settings, self._events.put
        client = Client(CallbackAPIVersion.VERSION2, clean_session=True, reconnect_on_failure=False)
        client.max_inflight_messages_set(3 * _WINDOW)
        if self._tls is not None:
            client.tls_set_context(self._tls)
        if its.user:
            client.username_pw_set(its.user, self._password)
        if its.site:
            if self._edge is None or self._asked:
                number = self._store.next_number('bdSeq', NUMBERS)
                self._edge, self._asked = EdgeNode(its.site, self._node, number), False
            client.will_set(*self._edge.death(time.time_ns() // _MILLISECOND), qos=1)
        else:
            client.will_set(f'{self._root}/online', 'false', qos=1, retain=True)
        client.on_connect = lambda c, u, flags, reason, p: put(('connected', reason))
        client.on_connect_fail = lambda c, u: put(('failed', None))
        client.on_disconnect = lambda c, u, flags, reason, p: put(('ended', reason))
        client.on_publish = lambda c, u, number, reason, p: put(('confirmed', number))
        client.on_message = lambda c, u, message: put(('message', message))
        client.connect_async(its.host, its.port, keepalive=_KEEPALIVE)
        client.loop_start()
        self._client = client

    async def take(self, taken: Taken) -> None:
        """Update the state of the lane, and store the record if it is a verdict."""
        self._states.take(taken)
        if isinstance(taken.record, Verdict):
            verdict, lane = taken.record, taken.lane
            key = f'{lane} {verdict.item_id} {verdict.t1} {verdict.t3}'
            self._store.add(key, lane, json.dumps(_body(self._states.of(lane), verdict)))

    async def turn(self) -> None:
        """Process the events of the connection, and publish changed states and waiting items.

        Before items are published, the new items are written to the disk. If the connection has
        failed or was lost, a new connection is attempted after `_RETRY` s.
        """
        with suppress(queue.Empty):
            while True:
                self._process(*self._events.get_nowait())
        self._store.commit()
        if self._client is None and time.monotonic() >= self._retry_at:
            self._connect()
        if time.monotonic() >= self._ready_at:
            for lane in list(self._states.lanes.values()):
                self._show(lane)
            self._send()

    def _process(self, event: str, value: Any) -> None:
        match event:
            case 'connected':
                self._asked = True
                if value.is_failure:
                    self._trouble = f'connection refused: {value}'
                else:
                    self._greet()
            case 'failed' | 'ended':
                lost = 'no connection' if event == 'failed' else f'connection lost: {value}'
                self._trouble = self._trouble or lost
                # Discard the client, because each connection needs a new client.
                self._ready_at, self._client = math.inf, None
                self._retry_at = time.monotonic() + _RETRY
            case 'confirmed':
                if (number := self._confirmations.pop(value, None)) is not None:
                    self._store.have_sent(number)
            case 'message':
                self._hear(value)

    def _greet(self) -> None:
        """Begin a session: subscribe, publish the birth message, and begin to wait for the mark."""
        self._trouble, self._confirmations, self._shown = '', {}, {}
        assert self._client is not None
        topics = [self._mark]
        if self._settings.commands:
            topics.append(f'{self._root}/+/command')
        if self._edge is not None:
            topics += [self._edge.topic('NCMD'), self._edge.topic('DCMD', '+')]
        self._client.subscribe([(topic, 1) for topic in topics])
        self._sent = 0
        self._bear()
        self._ready_at = time.monotonic() + _MARK_PATIENCE

    def _bear(self) -> None:
        self._born, self._shown = time.time_ns(), {}
        if self._edge is None:
            self._publish(f'{self._root}/online', 'true', retain=True)
        else:
            self._publish(*self._edge.birth({}, self._born // _MILLISECOND), qos=0)

    def _publish(self, topic: str, data: str | bytes, qos: int = 1, *, retain: bool = False) -> int:
        assert self._client is not None
        return self._client.publish(topic, data, qos, retain).mid

    def _show(self, lane: LaneState) -> None:
        """Publish the state of a lane if it has changed.

        With Sparkplug, the first state of a lane after the NBIRTH is a DBIRTH with all metrics of
        the lane. Each later state of the lane is a DDATA.
        """
        now, before = _state(lane), self._shown.get(lane.name)
        if now == before:
            return
        self._shown[lane.name] = now
        self._publish(self._topic(lane.name, 'state'), json.dumps(plain(now)), retain=True)
        if self._edge is not None:
            metrics = {_WORDS[name]: value for name, value in now.items()}
            if before is None:
                commands = dict(zip(_COMMANDS, ('', '', False), strict=True))
                own = commands if self._settings.commands else {}
                metrics |= {**_item_metrics(_body(lane, lane.verdict or _NOTHING)), **own}
            kind = 'DBIRTH' if before is None else 'DDATA'
            stamp = time.time_ns() // _MILLISECOND
            self._publish(*self._edge.message(kind, lane.name, metrics, stamp), qos=0)

    def _topic(self, lane: str, name: str) -> str:
        return f'{self._root}/{element(lane)}/{name}'

    def _send(self) -> None:
        """Publish waiting items, until `_WINDOW` items await confirmation."""
        room = _WINDOW - len(self._confirmations)
        for number, lane, body in list(self._store.after(self._sent, room)):
            content, self._sent = json.loads(body), number
            if lane not in self._shown:
                self._show(self._states.of(lane))
            if self._edge is not None:
                stamp = content['stamp_ns'] or self._born
                self._publish(
                    *self._edge.message(
                        'DDATA',
                        lane,
                        _item_metrics(content),
                        time.time_ns() // _MILLISECOND,
                        at=stamp // _MILLISECOND,
                        historical=stamp < self._born,
                    ),
                    qos=0,
                )
            self._publish(self._topic(lane, 'verdict'), json.dumps({'number': number, **content}))
            mark = json.dumps({'store': self._store.identity, 'number': number})
            self._confirmations[self._publish(self._mark, mark, retain=True)] = number

    def _hear(self, message: MQTTMessage) -> None:
        """Process a mark, a command or a rebirth request.

        Other messages and invalid messages are ignored.
        """
        with suppress(ValueError, KeyError, TypeError, IndexError):
            if message.topic == self._mark:
                self._hear_mark(json.loads(message.payload), retained=message.retain)
            elif self._edge is not None and message.topic == self._edge.topic('NCMD'):
                if decode(message.payload).get(REBIRTH) is True:
                    self._bear()
            elif self._settings.commands and not message.retain:
                self._hear_command(message)

    def _hear_mark(self, mark: dict[str, Any], *, retained: bool) -> None:
        if retained and self._sent == 0 and mark['store'] == self._store.identity:
            self._store.have_sent(int(mark['number']))
            self._ready_at = time.monotonic()

    def _hear_command(self, message: MQTTMessage) -> None:
        *_, device, last = message.topic.split('/')
        if last == 'command':
            given = dict(json.loads(message.payload))
            values = {f'Command/{str(name).capitalize()}': each for name, each in given.items()}
        else:
            device, values = last, decode(message.payload)
        lane = {element(name): name for name in self._states.lanes}[device]
        actions = {
            'Command/Product': ('select product', select_product),
            'Command/Batch': ('begin batch', new_batch),
        }
        for name, value in values.items():
            if name in actions and isinstance(value, str):
                what, action = actions[name]
                self._act(lane, f'{what} {one_line(value)}', partial(action, name=value))
            elif name == 'Command/Zero' and value is True:
                self._act(lane, 'zero', zero)

    @cached_property
    def _workshop(self) -> Workshop:
        return Workshop(self.intake.spinner, 'gateway_mqtt_work')

    def _act(self, lane: str, what: str, action: Any) -> None:
        task = asyncio.create_task(self._acted(lane, what, action))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _acted(self, lane: str, what: str, action: Any) -> None:
        services, its = await self._workshop.of(lane), self._settings
        person = Person(its.user or 'mqtt', f'{its.host}:{its.port}')
        outcome = await services.act(person, what, '', partial(action, services))
        self._publish(self._topic(lane, 'answer'), json.dumps({'what': what, **asdict(outcome)}))

    def findings(self, now: float) -> Iterable[Finding]:
        """Yield the finding on the connection to the broker and the waiting items."""
        dropped, waiting = self._store.dropped, self._store.waiting
        where = f'{self._settings.host}:{self._settings.port}'
        yield conclude(
            'Broker',
            f'connected to {where}',
            [
                error_if(
                    bool(self._trouble),
                    f'{where}: {self._trouble}; {waiting} items wait',
                    'check broker, network and certificates; items are kept on disk',
                ),
                warn_if(
                    dropped > 0,
                    f'{dropped} items were dropped, because more than the limit waited',
                    'increase mqtt.limit in the settings',
                ),
            ],
            {'waiting': str(waiting)},
        )

    async def close(self) -> None:
        """Publish the death message and disconnect, if connected, and close the store."""
        client = self._client
        if client is not None and not self._trouble:
            death: tuple[str, str | bytes] = f'{self._root}/online', 'false'
            if self._edge is not None:
                death = self._edge.death(time.time_ns() // _MILLISECOND)
            sent = client.publish(*death, qos=1, retain=self._edge is None)
            # Ignore the exceptions of paho if the connection is lost.
            with suppress(RuntimeError, ValueError):
                sent.wait_for_publish(_FAREWELL)
            client.disconnect()
        self._store.close()


def _body(lane: LaneState, verdict: Verdict) -> dict[str, Any]:
    stamp = verdict.t3 if verdict.t3 is not None else verdict.t1
    return {
        'lane': lane.name,
        'item': verdict.item_id,
        'stamp_ns': stamp,
        'time': None if stamp is None else utc(stamp),
        'mass_kg': _number(verdict.mass),
        'std_dev_kg': _number(verdict.std_dev),
        'deviation_kg': _number(lane.deviation(verdict)),
        'decision': verdict.decision.name,
        'reasons': list(verdict.reasons),
        'product': verdict.product,
        'batch': verdict.batch,
        'late': verdict.late,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _item_metrics(body: dict[str, Any]) -> dict[str, object]:
    def known(name: str) -> float:
        return math.nan if body[name] is None else float(body[name])

    return {
        'Item/Id': int(body['item']),
        'Item/Mass': known('mass_kg'),
        'Item/StandardDeviation': known('std_dev_kg'),
        'Item/Deviation': known('deviation_kg'),
        'Item/Decision': str(body['decision']),
        'Item/Reasons': ','.join(body['reasons']),
        'Item/Product': str(body['product']),
        'Item/Batch': str(body['batch']),
        'Item/Late': bool(body['late']),
    }


# Name of the Sparkplug metric for each value that `_state` returns.
_WORDS = {
    'state': 'State',
    'stop_reason': 'Stop/Reason',
    'stop_text': 'Stop/Text',
    'product': 'Product',
    'zero_kg': 'Zero/Offset',
    'alarms': 'Alarms',
}


def _state(lane: LaneState) -> dict[str, object]:
    return {
        'state': lane.pack_state.word,
        'stop_reason': '' if lane.stop is None else str(lane.stop.reason),
        'stop_text': '' if lane.stop is None else lane.stop.text,
        'product': '' if lane.product is None else lane.product.product,
        'zero_kg': round(lane.zero, 6),
        'alarms': len(lane.alarms),
    }


def make(settings: GatewaySettings) -> Gateway:
    """Return the MQTT gateway."""
    return MqttGateway(settings.mqtt or MqttSettings())
