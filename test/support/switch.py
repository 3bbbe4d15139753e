# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A network switch in a process: Ethernet frames between TAP devices, lost, late, or kept apart.

python3 test/support/switch.py SEED DESCRIPTOR...

It does what ``tc netem`` does, on kernels without it too. It reads its orders from stdin, one JSON
line each: `loss` (share of the frames), `delay` and `jitter` (s; frames pass one another where the
jitter is larger than their distance), `apart` (hosts that reach only one another). It answers each
line with its counts. Bytes of discovery are told from others by the UDP ports of RTPS.
"""

from collections import Counter
import heapq
import json
import os
import random
import select
import sys
import time
from typing import Any

_LONGEST = 65_536  # bytes of a frame
_PORT_BASE, _DOMAIN_GAIN = 7400, 250  # of RTPS 2.5, 9.6.2.3
_FIRST_UNICAST = 10  # offset of the ports of participants: even ones are for discovery
_UDP, _IPV4 = 17, b'\x08\x00'


class Switch:
    """A switch between TAP devices, by their file descriptors."""

    def __init__(self, seed: int, descriptors: list[int]) -> None:
        self._ports = descriptors
        self._chance = random.Random(seed)
        self._orders: dict[str, Any] = {'loss': 0.0, 'delay': 0.0, 'jitter': 0.0, 'apart': []}
        self._addresses: dict[bytes, int] = {}  # where a MAC address was seen
        self._waiting: list[tuple[float, int, int, bytes]] = []
        self._count = 0
        self._largest = 0  # number of the newest frame that has gone out
        self.counts: Counter[str] = Counter()

    def run(self) -> None:
        """Pass frames on until stdin is closed."""
        while True:
            due = self._waiting[0][0] - time.monotonic() if self._waiting else 1.0
            ready, _, _ = select.select([0, *self._ports], [], [], max(0.0, due))
            for each in ready:
                if each:
                    self._take(each)
                elif not self._obey():
                    return
            self._send_due()

    def _obey(self) -> bool:
        line = sys.stdin.buffer.raw.readline()  # type: ignore[attr-defined]
        if line:
            self._orders |= json.loads(line)
            print(json.dumps(self.counts), flush=True)
        return bool(line)

    def _take(self, port: int) -> None:
        frame = os.read(port, _LONGEST)
        self._addresses[frame[6:12]] = port
        to = self._addresses.get(frame[:6])
        for other in self._ports if to is None else (to,):
            if other != port:
                self._pass_on(port, other, frame)

    def _pass_on(self, port: int, other: int, frame: bytes) -> None:
        self._count += 1
        orders = self._orders
        apart = [self._ports[number] for number in orders['apart']]
        if (port in apart) != (other in apart):
            self.counts['kept apart'] += 1
        elif self._chance.random() < orders['loss']:
            self.counts['lost'] += 1
        else:
            late = orders['delay'] + orders['jitter'] * self._chance.random()
            entry = (time.monotonic() + late, self._count, other, frame)
            heapq.heappush(self._waiting, entry)

    def _send_due(self) -> None:
        now = time.monotonic()
        while self._waiting and self._waiting[0][0] <= now:
            _, number, port, frame = heapq.heappop(self._waiting)
            self.counts['passed another'] += number < self._largest
            self._largest = max(number, self._largest)
            self.counts['passed'] += 1
            kind = 'discovery' if is_discovery(frame) else 'other'
            self.counts[f'bytes of {kind}'] += len(frame)
            os.write(port, frame)


def is_discovery(frame: bytes) -> bool:
    """Tell whether a frame is of the discovery of RTPS: UDP on IPv4 to one of its ports."""
    if frame[12:14] != _IPV4 or frame[23] != _UDP:
        return False
    port = int.from_bytes(frame[36:38], 'big')
    offset = (port - _PORT_BASE) % _DOMAIN_GAIN
    return port >= _PORT_BASE and (offset == 0 or (offset >= _FIRST_UNICAST and offset % 2 == 0))


if __name__ == '__main__':
    Switch(int(sys.argv[1]), [int(each) for each in sys.argv[2:]]).run()
