# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clocks of the hosts of a line: each host answers the others with its time, by UDP.

With it goes what chrony says there, as chrony's bound may be the smaller one.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import math
import os
import select
import socket
import struct
import threading
import time

from checkweigher_bringup.hosts.chrony import Chrony
from checkweigher_dsp.health.findings import Finding
from checkweigher_dsp.health.host_clocks import Exchange, HostClockWatch, KeptClock

PORT = 11812
# Name, token, heard and answered, reference and bound of chrony; as long there as back.
_PACKET = struct.Struct('!8s8sqqId')
_NAME = b'cwclock2'
_UNKNOWN = KeptClock(0, math.nan)
_PERIOD = 0.25  # s
_BURST = 2  # exchanges a period
_PATIENCE = 0.1  # s


class HostClocks:
    """Comparison of this host's clock with those of the `others`, by name and address."""

    def __init__(
        self, address: str, others: Mapping[str, str], port: int = PORT,
        chrony: Chrony | None = None,
    ) -> None:  # fmt: skip
        self._chrony = chrony or Chrony()
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
        own = self._chrony.kept
        with self._lock:
            return [watch.finding(now, name, own) for name, watch in self._watches.items()]

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
            question = _PACKET.pack(_NAME, token, 0, 0, 0, math.nan)
            self._asking.sendto(question, (address, self._port))
            while select.select([self._asking], [], [], _PATIENCE)[0]:
                data, _ = self._asking.recvfrom(_PACKET.size + 1)
                came = time.time_ns()
                if len(data) == _PACKET.size and data[:16] == _NAME + token:
                    _, _, heard, answered, reference, bound = _PACKET.unpack(data)
                    kept = KeptClock(reference, bound) if bound >= 0 else None
                    return Exchange(sent, heard, answered, came, kept)
        except OSError:  # no way there
            pass
        return None


@contextmanager
def answering(
    address: str, port: int = PORT, clock: Callable[[], int] = time.time_ns,
    chrony: Chrony | None = None,
) -> Iterator[None]:  # fmt: skip
    """Answer other hosts with the time of `clock`, ns, while the block lasts."""
    said = chrony or Chrony()
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
                    kept = said.kept or _UNKNOWN
                    head = _NAME, data[8:16], heard, clock()
                    own.sendto(_PACKET.pack(*head, kept.reference, kept.bound), who)

        thread = threading.Thread(target=answer, name='clock', daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
