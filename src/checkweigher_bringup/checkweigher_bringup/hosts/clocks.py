# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clocks of the hosts of a line: each host answers the others with its time, by UDP."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import os
import select
import socket
import struct
import threading
import time

from checkweigher_dsp.health.findings import Finding
from checkweigher_dsp.health.host_clocks import Exchange, HostClockWatch

PORT = 11812
_PACKET = struct.Struct('!8s8sqq')  # name, token, heard and answered; as long there as back
_NAME = b'cwclock1'
_PERIOD = 1.0  # s
_BURST = 5  # exchanges a period
_PATIENCE = 0.1  # s


class HostClocks:
    """Comparison of this host's clock with those of the `others`, by name and address."""

    def __init__(self, address: str, others: Mapping[str, str], port: int = PORT) -> None:
        self._others = dict(others)
        self._port = port
        self._watches = {name: HostClockWatch() for name in others}
        self._lock = threading.Lock()
        self._ended = threading.Event()
        family = socket.AF_INET6 if ':' in address else socket.AF_INET
        self._asking = socket.socket(family, socket.SOCK_DGRAM)
        self._asking.bind((address, 0))
        self._thread = threading.Thread(target=self._compare, name='clocks', daemon=True)
        self._thread.start()

    def findings(self) -> list[Finding]:
        """Return what is known of each other clock."""
        now = time.monotonic()
        with self._lock:
            return [watch.finding(now, name) for name, watch in self._watches.items()]

    def close(self) -> None:
        """End the comparison."""
        self._ended.set()
        self._thread.join()
        self._asking.close()

    def _compare(self) -> None:
        while not self._ended.wait(_PERIOD):
            for name, address in self._others.items():
                for _ in range(_BURST):
                    if (exchange := self._exchange(address)) is None:
                        break
                    with self._lock:
                        self._watches[name].add(time.monotonic(), exchange)

    def _exchange(self, address: str) -> Exchange | None:
        token = os.urandom(8)
        try:
            sent = time.time_ns()
            self._asking.sendto(_PACKET.pack(_NAME, token, 0, 0), (address, self._port))
            while select.select([self._asking], [], [], _PATIENCE)[0]:
                data, _ = self._asking.recvfrom(_PACKET.size + 1)
                came = time.time_ns()
                if len(data) == _PACKET.size and data[:16] == _NAME + token:
                    _, _, heard, answered = _PACKET.unpack(data)
                    return Exchange(sent, heard, answered, came)
        except OSError:  # no way there
            pass
        return None


@contextmanager
def answering(
    address: str, port: int = PORT, clock: Callable[[], int] = time.time_ns
) -> Iterator[None]:
    """Answer other hosts with the time of `clock`, ns, while the block lasts."""
    family = socket.AF_INET6 if ':' in address else socket.AF_INET
    ended = threading.Event()
    with socket.socket(family, socket.SOCK_DGRAM) as own:
        own.bind((address, port))

        def answer() -> None:
            while not ended.is_set():
                if not select.select([own], [], [], _PATIENCE)[0]:
                    continue
                data, who = own.recvfrom(_PACKET.size + 1)
                heard = clock()
                if len(data) == _PACKET.size and data.startswith(_NAME):
                    own.sendto(_PACKET.pack(_NAME, data[8:16], heard, clock()), who)

        thread = threading.Thread(target=answer, name='clock', daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
