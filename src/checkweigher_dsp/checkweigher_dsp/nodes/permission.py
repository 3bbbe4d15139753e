# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The permission that the node reject gives: ten times a second, and whenever it changes."""

from collections.abc import Callable, Mapping
import threading
import time

from checkweigher_core.health.findings import Finding
from checkweigher_core.records import NANOSECONDS, Permission, StreamStatus
from checkweigher_core.ros import ports
from checkweigher_core.ros.outputs import LOCK, Input
from checkweigher_core.ros.port_node import PortNode
from checkweigher_dsp.rejection.permission import PermissionRule

_PERIOD = 0.1  # s
_SAMPLES_TIME = 0.4  # s; the segmenter tells of its samples every 0.2 s and a block
_MARGIN = 0.001  # s


class PermissionGiver:
    """Output of the permission of a lane.

    It has a thread of its own, since each wake of the executor takes 1 ms, and gives nothing while
    a callback of the process has the lock: a node that hangs gives none.

    Parameters
    ----------
    node : PortNode
        The node that gives it.
    publishers : mapping of str to Input
        Inputs that need a publisher, by the names of the rule: ``eyes`` and ``load cell``.
    is_stopped : callable
        Returns whether a stop is requested.
    deadlines : bool
        Whether the permission runs out.
    """

    def __init__(
        self,
        node: PortNode,
        publishers: Mapping[str, Input],
        is_stopped: Callable[[], bool],
        *,
        deadlines: bool,
    ) -> None:
        self._rule = PermissionRule(_SAMPLES_TIME, deadlines=deadlines)
        self._publishers = publishers
        self._is_stopped = is_stopped
        self._output = node.output(ports.PERMISSION)
        self._stages = {
            stage: node.subscribe(port, lambda _: None, needed=False)
            for stage, port in ports.ALIVE.items()
        }
        self._ending = threading.Event()
        threading.Thread(target=self._repeat, name='permission', daemon=True).start()

    def end(self) -> None:
        """Give no more; the node is about to be destroyed."""
        self._ending.set()

    def _repeat(self) -> None:
        while not self._ending.wait(self._pause()):
            with LOCK:
                if not self._ending.is_set():
                    self.give()

    def _pause(self) -> float:
        """Return the time to the next word, s: soon after the samples are no longer fresh."""
        left = self._rule.fresh_for(time.monotonic_ns()) / NANOSECONDS
        return left + _MARGIN if 0 < left < _PERIOD else _PERIOD

    def set_deadlines(self, *, deadlines: bool) -> None:
        """Set whether the permission runs out."""
        self._rule.deadlines = deadlines

    def add_progress(self, status: StreamStatus) -> None:
        """Add a status of the segmenter."""
        self._rule.add_progress(status, time.monotonic_ns())

    def give(self) -> None:
        """Send whether the line may run now."""
        present = {
            **{name: entry.count() > 0 for name, entry in self._publishers.items()},
            **{stage: entry.alive for stage, entry in self._stages.items()},
        }
        run = self._rule.may_run(present, time.monotonic_ns(), stopped=self._is_stopped())
        self._output.send(Permission(time.time_ns(), run))

    def finding(self) -> Finding:
        """Return the aspect Permission of the diagnostics."""
        return self._rule.finding()
