# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Publisher of the permission to run the line.

The node `reject` publishes the permission ten times per second, and at each change of the stop
request.
"""

from collections.abc import Callable, Mapping
from functools import partial
import time

from checkweigher_core.records import NANOSECONDS, Permission
from checkweigher_core.ros import ports
from checkweigher_core.ros.outputs import Input
from checkweigher_core.ros.port_node import PortNode
from checkweigher_dsp.rejection.permission import PermissionRule

_PERIOD = round(0.1 * NANOSECONDS)  # interval between two permission messages in ns.
# Longest age of a sign of life in s. A stage sends a sign of life every 0.2 s, or later if a long
# block of samples delays it.
_FRESH_TIME = 0.4
_MARGIN = round(0.001 * NANOSECONDS)  # delay after the expiry of a sign of life in ns


class PermissionGiver:
    """Output of the permission to run the line.

    No message is sent while a callback of the process runs, so that a node that hangs does not give
    permission. `publishers` are the inputs that need a publisher, by the names ``eyes`` and ``load
    cell``. `is_stopped` returns whether a stop is requested. If `deadlines` is false, only a stop
    request withdraws the permission.
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
        self._timer = node.create_one_shot_timer(self._repeat)
        self._timer.set(time.monotonic_ns() + _PERIOD)

    def _repeat(self) -> None:
        self.give()
        # Wake up as soon as the sign of life of a stage expires, to withdraw the permission.
        now = time.monotonic_ns()
        left = self.rule.fresh_for(now)
        self._timer.set(now + (left + _MARGIN if 0 < left < _PERIOD else _PERIOD))

    def _add_sign(self, stage: str, _: object) -> None:
        self.rule.add_sign(stage, time.monotonic_ns())

    def give(self) -> None:
        """Send the permission, or its withdrawal."""
        for stage, entry in self._stages.items():
            # A stage in this process needs no signs of life, because the timer of this node also
            # stops if the stage hangs.
            if entry.makers:
                self._add_sign(stage, None)
        present = {name: entry.count() > 0 for name, entry in self._publishers.items()}
        run = self.rule.may_run(present, time.monotonic_ns(), stopped=self._is_stopped())
        self._output.send(Permission(time.time_ns(), run))
