# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Notifications to systemd, if it has started this process as a service of Type=notify."""

from collections.abc import Iterable
import math
import os
import socket

from checkweigher_bringup.supervision.processes import SILENCE, START

_VARIABLE = 'NOTIFY_SOCKET'
_PERIOD = 1.0  # minimum time in s between two notifications


def supervises() -> bool:
    """Return whether systemd supervises this process."""
    return _VARIABLE in os.environ


class Watchdog:
    """Watchdog of systemd, which is fed while all nodes of a line send diagnostics.

    Times are in s on a monotonic clock. Each node sends its diagnostics from the thread that
    weighs, so a node that hangs is silent.
    """

    def __init__(self, nodes: Iterable[str]) -> None:
        self._heard = dict.fromkeys(nodes, -math.inf)
        self._fed = -math.inf

    def heard(self, node: str, now: float) -> None:
        """Record diagnostics of a node. Nodes that do not belong to the line are ignored."""
        if node in self._heard:
            self._heard[node] = now

    def restarted(self, now: float) -> None:
        """Allow the nodes `START` s until their next diagnostics, because the line is restarted."""
        self._heard = dict.fromkeys(self._heard, now + START - SILENCE)

    def feed(self, now: float) -> None:
        """Notify systemd that the line runs, as sd_notify(3) describes.

        A notification is sent only if each node has sent diagnostics within the last `SILENCE` s,
        or within the time that `restarted` allows. Nothing is sent if systemd does not supervise
        this process, or within `_PERIOD` s after the previous notification.
        """
        if not supervises() or now - self._fed < _PERIOD:
            return
        if now - min(self._heard.values(), default=now) > SILENCE:
            return
        self._fed = now
        address = os.environ[_VARIABLE]
        if address.startswith('@'):  # a socket in the abstract namespace
            address = f'\0{address[1:]}'
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notice:
            notice.sendto(b'READY=1\nWATCHDOG=1', address)
