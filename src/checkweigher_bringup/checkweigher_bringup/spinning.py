"""Running nodes beside the command that uses them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import threading

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


@contextmanager
def spinning(
    make_nodes: Callable[[], Sequence[Node]], namespace: str = ''
) -> Iterator[threading.Thread]:
    """Spin nodes in a thread for as long as the block lasts.

    Signals stay with Python: Ctrl-C is a KeyboardInterrupt in the block, and what the block has
    to finish it finishes with the nodes still there.

    Parameters
    ----------
    make_nodes : callable
        Makes the nodes, once ROS is there.
    namespace : str
        Of all nodes.
    """
    rclpy.init(args=ros_arguments(namespace), signal_handler_options=SignalHandlerOptions.NO)
    try:
        executor = SingleThreadedExecutor()
        nodes = make_nodes()
        for node in nodes:
            executor.add_node(node)

        def spin() -> None:
            try:
                executor.spin()
            except ExternalShutdownException:
                pass

        thread = threading.Thread(target=spin, name='executor', daemon=True)
        thread.start()
        try:
            yield thread
        finally:
            executor.shutdown()
            thread.join(timeout=2.0)
            for node in reversed(nodes):
                node.destroy_node()
    finally:
        rclpy.try_shutdown()


def ros_arguments(namespace: str) -> list[str]:
    """Return the ROS arguments that put nodes into a namespace."""
    return ['--ros-args', '-r', f'__ns:=/{namespace}'] if namespace else []
