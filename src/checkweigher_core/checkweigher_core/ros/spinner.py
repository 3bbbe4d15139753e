# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Thread that runs an executor of rclpy."""

from collections.abc import Callable
from concurrent.futures import Future, wait
import threading

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from checkweigher_core.printable import one_line
from checkweigher_core.ros.outputs import LOCK, connect
from checkweigher_core.ros.port_node import PortNode

_PATIENCE = 10.0  # longest wait for the thread in s


class Spinner:
    """Thread with an executor of rclpy for some nodes.

    With the nodes of a line, each wake of the executor takes 1 ms or more, so frequent events must
    not wake the executor. Just before the thread ends, it calls the function `on_end`. `error` is
    the exception that ended the thread, or None.
    """

    def __init__(self, on_end: Callable[[], None] = lambda: None) -> None:
        self.error: Exception | None = None
        self._on_end = on_end
        self._executor = SingleThreadedExecutor()
        self._nodes: list[Node] = []
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._spin, name='executor', daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether the thread still runs. The thread ends if the ROS context is shut down."""
        return self._thread.is_alive()

    def add(self, *nodes: Node) -> None:
        """Connect nodes with each other, add them to the executor, and start them in order."""
        connect(nodes)
        self._nodes += nodes
        for node in nodes:
            self._executor.add_node(node)
        with LOCK:
            for node in nodes:
                if isinstance(node, PortNode):
                    node.spinner = self
                    node.start()

    def remove(self, node: Node) -> None:
        """Remove a node from the executor, and destroy it."""
        self._nodes.remove(node)

        def destroy() -> None:
            self._executor.remove_node(node)
            node.destroy_node()

        self.call(destroy)

    def call(self, function: Callable[[], object]) -> None:
        """Call a function in the thread of the executor, and wait until the function returns.

        A function that destroys entities or cancels timers must run in the thread of the executor,
        which uses the entities and timers. An exception that the function raises is raised again in
        the calling thread. Raises RuntimeError if the function has not returned within 10 s.
        """
        answer: Future[object] = Future()

        def locked() -> None:
            try:
                with LOCK:
                    answer.set_result(function())
            except Exception as error:
                answer.set_exception(error)

        self._executor.create_task(locked)
        if not wait([answer], _PATIENCE).done:
            raise RuntimeError('the executor does not answer')
        answer.result()

    def stop(self) -> None:
        """End the thread, and destroy the nodes in reverse order.

        The method waits for the end of the thread for at most 10 s.
        """
        # Shut down the executor only after the thread, which uses it, has ended.
        self._executor.create_task(self._stopping.set)
        self._thread.join(timeout=_PATIENCE)
        if not self._thread.is_alive():
            self._executor.shutdown()
        with LOCK:
            for node in reversed(self._nodes):
                node.destroy_node()

    def _spin(self) -> None:
        try:
            while not self._stopping.is_set():
                try:
                    self._executor.spin_once()
                except ExternalShutdownException:
                    break
                except Exception as error:
                    # Continue after a failed task, or a malformed request or response.
                    if not rclpy.ok() or not self._nodes:
                        self.error = error
                        raise
                    self._nodes[0].get_logger().error(one_line(f'{type(error).__name__}: {error}'))
        finally:
            self._on_end()
