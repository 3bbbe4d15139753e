# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The driver, or the whole line, with the time at which each outfeed edge could be sent."""

from pathlib import Path
import sys
import time

from rclpy.node import Node

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_core.recording import Event
from checkweigher_core.records import Eye, EyeEdge, SampleBlock
from checkweigher_core.ros.running import run_all
from checkweigher_driver.driver_node import DriverNode
from checkweigher_production.nodes.product import ProductNode


class StampingDriver(DriverNode):
    """Driver that records the monotonic time of each edge t3 and of the last sample before it.

    The sample comes first: its block is cut at the edge, and both are due at once.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._stamps: list[tuple[int, int]] = []
        self._last_block = 0
        super().__init__()

    def _note(self, event: Event) -> None:
        now = time.monotonic_ns()
        if isinstance(event, SampleBlock):
            self._last_block = now
        elif isinstance(event, EyeEdge) and event.eye == Eye.OUTFEED and event.blocked:
            self._stamps.append((event.stamp, self._last_block))
        super()._note(event)

    def destroy_node(self) -> None:
        """Write the recorded times, and destroy the node."""
        lines = [f'{stamp} {there}\n' for stamp, there in self._stamps]
        self._file.write_text(''.join(lines), encoding='ascii')
        super().destroy_node()


def _nodes(what: str, file: Path) -> list[Node]:
    stages = [make() for make in reversed(STAGE_NODES.values())] if what == 'line' else []
    return [*stages, *([ProductNode()] if stages else []), StampingDriver(file)]


def main() -> None:
    """Run `stamping.py driver FILE` or `stamping.py line FILE`, ROS arguments behind."""
    what, file = sys.argv[1], Path(sys.argv[2])
    run_all(lambda: _nodes(what, file), [sys.argv[0], *sys.argv[3:]])


if __name__ == '__main__':
    main()
