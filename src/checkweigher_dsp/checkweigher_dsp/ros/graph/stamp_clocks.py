# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clocks of the hosts that stamp the samples and the edges of a lane."""

from collections.abc import Collection
from itertools import combinations
import time
from typing import Any

from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.health.host_clocks import LARGEST_OFFSET, ClockBoard
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.graph.hosts import supervised_hosts
from checkweigher_dsp.ros.port_node import PortNode, locked


class StampClocks:
    """Whether hosts have one clock, by what their supervisors tell of it.

    Hosts are those of `host_of`. The diagnostics are listened to from when there are two of them.
    """

    def __init__(self, node: PortNode) -> None:
        self._node = node
        self._board = ClockBoard()
        self._listens = False

    def apart(self, hosts: Collection[bytes]) -> str:
        """Return why stamps of some hosts cannot be compared, empty if they can."""
        if len(hosts) < 2:
            return ''
        self._listen()
        names = supervised_hosts(self._node)
        if any(host not in names for host in hosts):
            return 'samples and edges come from two hosts, of which one has no supervisor'
        now = time.monotonic()
        for one, other in combinations(sorted(names[host] for host in hosts), 2):
            if not self._board.agree(now, one, other):
                limit = f'{1e3 * LARGEST_OFFSET:g} ms'
                return (
                    f'samples and edges come from {one} and {other}, whose clocks are not known to '
                    f'agree within {limit}'
                )
        return ''

    def _listen(self) -> None:
        if not self._listens:
            self._listens = True
            port = ports.DIAGNOSTICS
            take = locked(self._on_diagnostics)
            self._node.create_subscription(port.type, port.name, take, port.stage_qos)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            level = Level(min(status.level[0], Level.STALE))
            self._board.add(time.monotonic(), status.name, level)
