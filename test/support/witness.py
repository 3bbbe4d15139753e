# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tell the verdicts and edges of lanes on stdout, one JSON line each.

python3 test/support/witness.py lane1 lane2
"""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
import json
import sys
import time
from typing import Any

from checkweigher_bringup.spinning import spinning
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode


def tell(lane: str, port: ports.Port, record: Any) -> None:
    """Print a record of a lane as a line of JSON."""
    line = {'lane': lane, 'topic': port.name, 'came': time.monotonic_ns()}
    print(json.dumps({**line, **asdict(record)}), flush=True)


def main(lanes: Sequence[str]) -> None:
    """Listen until stdin is closed."""
    with spinning() as spinner:
        for lane in lanes:
            node = PortNode('witness', namespace=lane)
            for port in (ports.VERDICT, ports.PHOTO_EYES):
                node.subscribe(port, partial(tell, lane, port), qos=port.qos)
            spinner.add(node)
        print(json.dumps({'topic': 'ready'}), flush=True)
        sys.stdin.read()


if __name__ == '__main__':
    main(sys.argv[1:])
