# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A broker, Debian's mosquitto, and a host of Sparkplug B that listens to it."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
import json
from pathlib import Path
import shutil
import socket
import subprocess
import threading
from typing import Any, NamedTuple

from authority import Pair
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion
import pytest
from running import free_port, wait_for

from checkweigher_gateways.sparkplug import Payload

MOSQUITTO = shutil.which('mosquitto', path='/usr/sbin:/usr/bin:/usr/local/sbin')
needs_mosquitto = pytest.mark.skipif(MOSQUITTO is None, reason="Debian's mosquitto is missing")


class Broker:
    """A broker on a port of its own, which can be killed and started again."""

    def __init__(self, folder: Path, *more: str) -> None:
        self.port = free_port()
        self._file = folder / 'mosquitto.conf'
        lines = f'listener {self.port} 127.0.0.1', 'allow_anonymous true', 'user root', *more
        self._file.write_text('\n'.join(lines) + '\n')
        self.process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        """Start the broker, and wait until it listens."""
        words = [str(MOSQUITTO), '-c', str(self._file)]
        self.process = subprocess.Popen(words, stderr=subprocess.PIPE)
        assert self.process.stderr is not None
        while b'running' not in (line := self.process.stderr.readline()):
            assert line, 'mosquitto has ended'

    def kill(self) -> None:
        """Kill the broker."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            assert self.process.stderr is not None
            self.process.stderr.close()


@contextmanager
def broker(folder: Path, *more: str) -> Iterator[Broker]:
    """Run a broker with further lines of its configuration."""
    made = Broker(folder, *more)
    try:
        yield made
    finally:
        made.kill()


class Link:
    """A link to a port of this computer that can be cut, for one client at a time."""

    def __init__(self, to: int) -> None:
        self.port, self._to = free_port(), to
        self._ends: list[socket.socket] = []
        self.restore()

    def restore(self) -> None:
        """Let clients connect."""
        server = socket.create_server(('127.0.0.1', self.port))
        self._ends = [server]
        threading.Thread(target=self._connect, args=(server,), daemon=True).start()

    def _connect(self, server: socket.socket) -> None:
        with suppress(OSError):
            while True:
                near = server.accept()[0]
                try:
                    far = socket.create_connection(('127.0.0.1', self._to))
                except OSError:  # nobody listens there at present
                    near.close()
                    continue
                self._ends += [near, far]
                for ends in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=ends, daemon=True).start()

    def _carry(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)

    def cut(self) -> None:
        """Break each connection, and refuse further ones."""
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()


class Data(NamedTuple):
    """A message of Sparkplug B: kind, device, sequence number, and its metrics by name."""

    kind: str
    device: str
    seq: int | None
    metrics: dict[str, Any]

    def value(self, name: str) -> Any:
        """Return a value, None for null."""
        metric = self.metrics[name]
        kind = metric.WhichOneof('value')
        return None if metric.is_null else getattr(metric, kind)


class Host:
    """A host that keeps what comes, and checks that each sequence of numbers has no gap."""

    def __init__(self, port: int, pair: Pair | None = None, authority: Path | None = None) -> None:
        self.messages: list[Data] = []
        self.json: dict[str, list[Any]] = defaultdict(list)
        self.client = Client(CallbackAPIVersion.VERSION2)
        if pair is not None:
            self.client.tls_set(str(authority), str(pair.certificate), str(pair.key))
        self.client.on_message = self._take
        subscribed: list[bool] = []
        self.client.on_subscribe = lambda *_: subscribed.append(True)
        self.client.connect('127.0.0.1', port)
        self.client.loop_start()
        self.client.subscribe([('spBv1.0/#', 0), ('checkweigher/#', 1)])
        wait_for(lambda: subscribed)

    def _take(self, client: Client, data: Any, message: MQTTMessage) -> None:
        if not message.topic.startswith('spBv1.0/'):
            self.json[message.topic.split('/', 2)[2]].append(json.loads(message.payload))
            return
        assert not message.retain
        _, _, kind, _, *device = message.topic.split('/')
        payload = Payload.FromString(message.payload)
        seq = payload.seq if payload.HasField('seq') else None
        metrics = {each.name: each for each in payload.metrics}
        self.messages.append(Data(kind, ''.join(device), seq, metrics))

    def of(self, kind: str) -> list[Data]:
        """Return the messages of a kind."""
        return [each for each in self.messages if each.kind == kind]

    def send(self, topic: str, **values: Any) -> None:
        """Send a command of Sparkplug B."""
        payload = Payload(timestamp=1)
        for name, value in values.items():
            metric = payload.metrics.add(name=name.replace('__', '/').replace('_', ' '))
            field = 'boolean_value' if isinstance(value, bool) else 'string_value'
            setattr(metric, field, value)
        self.client.publish(topic, payload.SerializeToString()).wait_for_publish()

    def check_sequences(self) -> None:
        """Check that each NBIRTH has number 0, and each message after it the next one."""
        expected = None
        for each in self.messages:
            if each.kind == 'NBIRTH':
                expected = 0
            if each.kind in ('NBIRTH', 'DBIRTH', 'DDATA') and expected is not None:
                assert each.seq == expected, each.kind
                expected = (expected + 1) % 256

    def close(self) -> None:
        """Leave the broker."""
        self.client.disconnect()
        self.client.loop_stop()
