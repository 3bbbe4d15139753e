# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Program that runs the whole line, or some of its nodes, in one process.

The arguments name the nodes, as in ``line driver reject --ros-args ...``. Without names, all nodes
run.
"""

from collections.abc import Callable, Collection
from functools import partial
import os
import sys

# OpenBLAS reads this variable when numpy is imported, so it is set before the imports below.
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
# The nodes of a process get each record in this order. The node `reject` is the first, so that it
# gets an edge of a product before the estimate that depends on the edge. The nodes shut down in the
# reverse order. The driver ends first, so that items on the belt still get their verdicts.
NODE_CLASSES: dict[str, Callable[[], Node]] = {
    'reject': partial(RejectNode, keep_numbers=True),
    'identifier': IdentifierNode,
    'denoise': DenoiseNode,
    'segmenter': partial(SegmenterNode, keep_numbers=True),
    'product': ProductNode,
    'driver': DriverNode,
}


def make_line(names: Collection[str] = ()) -> list[Node]:
    """Create the nodes with the given names, or all nodes if `names` is empty.

    Raises `ParameterError` if a name is unknown.
    """
    for name in names:
        if name not in NODE_CLASSES:
            raise ParameterError(f'{name}: is not one of the nodes {", ".join(NODE_CLASSES)}')
    return [make() for name, make in NODE_CLASSES.items() if not names or name in names]


def main() -> None:
    """Run the nodes that the arguments name."""
    run_all(partial(make_line, remove_ros_args(sys.argv)[1:]))


if __name__ == '__main__':
    main()
