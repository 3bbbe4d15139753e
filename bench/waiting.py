"""Run a node and print when it waits for its first message, s of the monotonic clock."""

from importlib import import_module
import sys
import time

from rclpy.node import Node

from checkweigher_dsp.ros.cached_executor import CachedExecutor


class _Printing:
    """Stands in front of the method that adds a node to the executor."""

    def __init__(self) -> None:
        self._add = CachedExecutor.add_node

    def __call__(self, executor: CachedExecutor, node: Node) -> bool:
        print(time.monotonic(), flush=True)
        return self._add(executor, node)


if __name__ == '__main__':
    printing = _Printing()
    CachedExecutor.add_node = lambda self, node: printing(self, node)  # type: ignore[method-assign]
    import_module(sys.argv[1]).main([sys.argv[0], *sys.argv[2:]])
