# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tell the verdicts and edges of lanes on stdout, one JSON line each.

python3 test/support/witness.py lane1 lane2
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
import json
import sys
import time
from typing import Any

from rclpy.node import Node

from checkweigher_bringup.spinning import spinning
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_record


class Witness(Node):
    """Listens to one lane."""

    def __init__(self, lane: str) -> None:
        super().__init__('witness', namespace=lane)
        self._listen(ports.VERDICT, lambda message: asdict(to_record(ports.VERDICT, message)))
        self._listen(ports.PHOTO_EYES, lambda message: asdict(to_record(ports.PHOTO_EYES, message)))

    def _listen(self, topic: ports.Port, content: Callable[[Any], dict[str, Any]]) -> None:
        lane = self.get_namespace().strip('/')

        def tell(message: Any) -> None:
            line = {'lane': lane, 'topic': topic.name, 'came': time.monotonic_ns()}
            print(json.dumps({**line, **content(message)}), flush=True)

        self.create_subscription(topic.type, topic.name, tell, topic.qos)


def main(lanes: Sequence[str]) -> None:
    """Listen until stdin is closed."""
    with spinning() as spinner:
        for lane in lanes:
            spinner.add(Witness(lane))
        print(json.dumps({'topic': 'ready'}), flush=True)
        sys.stdin.read()


if __name__ == '__main__':
    main(sys.argv[1:])
