# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Output of the permission by the node reject, ten times a second and at each change."""

from collections.abc import Callable, Mapping
from functools import partial
import threading
import time

from checkweigher_core.records import NANOSECONDS, Permission
from checkweigher_core.ros import ports
from checkweigher_core.ros.outputs import LOCK, Input
from checkweigher_core.ros.port_node import PortNode
from checkweigher_dsp.rejection.permission import PermissionRule

_PERIOD = 0.1  # s
# s. The segmenter publishes its status every 0.2 s, or after a longer block, the others a sign of
# life every 0.15 s.
_FRESH_TIME = 0.4
_MARGIN = 0.001  # s


class PermissionGiver:
    """Output of the permission of a lane.

    It has its own thread, because each wake of the executor takes 1 ms. It sends nothing while a
    callback of the process has the lock, so a node that hangs gives no permission.

    Parameters
    ----------
    node : PortNode
        Node that publishes it.
    publishers : mapping of str to Input
        Inputs that need a publisher, by their names in the rule: ``eyes`` and ``load cell``.
    is_stopped : callable
        Returns whether a stop is requested.
    deadlines : bool
        Whether the permission runs out.

    Attributes
    ----------
    rule : PermissionRule
        Rule by which the line may run.
    """

    def __init__(
        self,
        node: PortNode,
        publishers: Mapping[str, Input],
        is_stopped: Callable[[], bool],
        *,
        deadlines: bool,
    ) -> None:
        self.rule = PermissionRule(_FRESH_TIME, ports.ALIVE, deadlines=deadlines)
        self._publishers = publishers
        self._is_stopped = is_stopped
        self._output = node.output(ports.PERMISSION)
        self._stages = {
            stage: node.subscribe(port, partial(self._add_sign, stage), needed=False)
            for stage, port in ports.ALIVE.items()
        }
        self._ending = threading.Event()
        threading.Thread(target=self._repeat, name='permission', daemon=True).start()

    def end(self) -> None:
        """Send no more, because the node is about to be destroyed."""
        self._ending.set()

    def _repeat(self) -> None:
        while not self._ending.wait(self._pause()):
            with LOCK:
                if not self._ending.is_set():
                    self.give()

    def _pause(self) -> float:
        """Return the time to the next message in s, at most until a sign is not fresh."""
        left = self.rule.fresh_for(time.monotonic_ns()) / NANOSECONDS
        return left + _MARGIN if 0 < left < _PERIOD else _PERIOD

    def _add_sign(self, stage: str, _: object) -> None:
        self.rule.add_sign(stage, time.monotonic_ns())

    def give(self) -> None:
        """Send the permission, or its withdrawal."""
        for stage, entry in self._stages.items():
            if entry.makers:  # a stage of this process needs no sign
                self._add_sign(stage, None)
        present = {name: entry.count() > 0 for name, entry in self._publishers.items()}
        run = self.rule.may_run(present, time.monotonic_ns(), stopped=self._is_stopped())
        self._output.send(Permission(time.time_ns(), run))
