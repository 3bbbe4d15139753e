# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole line in one process: six nodes on one executor."""

from functools import partial
import os

# As in checkweigher_dsp.nodes, which comes too late: rclpy imports numpy.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from rclpy.node import Node

from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.nodes.denoise import DenoiseNode
from checkweigher_dsp.nodes.identifier import IdentifierNode
from checkweigher_dsp.nodes.product import ProductNode
from checkweigher_dsp.nodes.reject import RejectNode
from checkweigher_dsp.nodes.segmenter import SegmenterNode
from checkweigher_dsp.ros.running import run_all

STAGE_NODES = {
    'segmenter': SegmenterNode,
    'denoise': DenoiseNode,
    'identifier': IdentifierNode,
    'reject': RejectNode,
}


def make_line() -> list[Node]:
    """Make all nodes of the line, in the order in which they start and take a record.

    They shut down in the opposite order: the driver first, so that the items on the belt still get
    their verdict, and reject last. Reject hears of an edge before the estimate that rests on it.
    """
    return [*(STAGE_NODES[name]() for name in reversed(STAGE_NODES)), ProductNode(), DriverNode()]


main = partial(run_all, make_line)

if __name__ == '__main__':
    main()
