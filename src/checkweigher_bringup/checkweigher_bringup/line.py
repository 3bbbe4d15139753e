# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole line, or some of its nodes, in one process.

The arguments name the nodes (default: all): ``line driver reject --ros-args ...``
"""

from collections.abc import Callable, Collection
from functools import partial
import os
import sys

# checkweigher_dsp.nodes sets this too late, because rclpy imports numpy before it.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from checkweigher_core.parameters import ParameterError
from checkweigher_core.ros.running import run_all
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.nodes.denoise import DenoiseNode
from checkweigher_dsp.nodes.identifier import IdentifierNode
from checkweigher_dsp.nodes.reject import RejectNode
from checkweigher_dsp.nodes.segmenter import SegmenterNode
from checkweigher_production.nodes.product import ProductNode

STAGE_NODES = {
    'segmenter': SegmenterNode,
    'denoise': DenoiseNode,
    'identifier': IdentifierNode,
    'reject': RejectNode,
}


NODE_CLASSES: dict[str, Callable[[], Node]] = {
    'reject': partial(RejectNode, keep_numbers=True),
    'identifier': IdentifierNode,
    'denoise': DenoiseNode,
    'segmenter': partial(SegmenterNode, keep_numbers=True),
    'product': ProductNode,
    'driver': DriverNode,
}


def make_line(names: Collection[str] = ()) -> list[Node]:
    """Make the nodes with these names (default: all), in the order in which they get a record.

    Reject is first, so it gets an edge before the estimate that depends on it. The nodes shut down
    in reverse order, the driver first, so that items on the belt still get their verdicts.
    """
    for name in names:
        if name not in NODE_CLASSES:
            raise ParameterError(f'{name}: no such node; there are {", ".join(NODE_CLASSES)}')
    return [make() for name, make in NODE_CLASSES.items() if not names or name in names]


def main() -> None:
    """Run the nodes that the command line names."""
    run_all(partial(make_line, remove_ros_args(sys.argv)[1:]))


if __name__ == '__main__':
    main()
