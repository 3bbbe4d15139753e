"""Nodes beside the command that uses them: in its process, or in processes of their own."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
import signal
import subprocess
import sys
import threading

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
import yaml

from checkweigher_dsp.ros.delivery import Delivery, delivering
from checkweigher_dsp.ros.executor import make_executor

Process = subprocess.Popen[bytes]

_PROCESS_PATIENCE = 5.0  # s, for a process to end by itself
_PATIENCE = 10.0  # s
_END_PATIENCE = 2.0  # s


class Spinner:
    """Spins nodes in a thread.

    Parameters
    ----------
    delivery : Delivery
        Hands messages over between the nodes.
    """

    def __init__(self, delivery: Delivery) -> None:
        self._delivery = delivery
        self._executor = make_executor(delivery=delivery)
        self._nodes: list[Node] = []
        self._stopping = False
        self._thread = threading.Thread(target=self._spin, name='executor', daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether the nodes are still served: an exception in a callback ends that."""
        return self._thread.is_alive()

    def add(self, node: Node) -> None:
        """Serve one more node."""
        self._nodes.append(node)
        self._executor.add_node(node)

    def remove(self, node: Node) -> None:
        """Destroy a node before the others."""
        self._nodes.remove(node)
        # In the thread that spins: it may be about to wait for what is destroyed here.
        done = threading.Event()

        def destroy() -> None:
            self._executor.remove_node(node)
            node.destroy_node()
            done.set()

        self._executor.create_task(destroy)
        if not done.wait(_PATIENCE):
            raise RuntimeError(f'{node.get_name()}: could not be destroyed')

    def stop(self) -> None:
        """Stop, and destroy the nodes in the order opposite to that in which they came."""
        # Shut down only when nobody spins it any more: rclpy takes away what a wait is using.
        self._executor.create_task(self._end)
        self._thread.join(timeout=_END_PATIENCE)
        if not self._thread.is_alive():
            self._executor.shutdown()
        with self._delivery.turn():  # a source may still be publishing
            for node in reversed(self._nodes):
                node.destroy_node()

    def _end(self) -> None:
        self._stopping = True

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            while not self._stopping:
                self._executor.spin_once(timeout_sec=_PATIENCE)


@contextmanager
def spinning(namespace: str = '') -> Iterator[Spinner]:
    """Have ROS and a spinner for as long as the block lasts.

    Signals stay with Python: Ctrl-C is a KeyboardInterrupt in the block, and what the block has
    to finish it finishes with the nodes still there.

    Parameters
    ----------
    namespace : str
        Of all nodes that the block makes.
    """
    rclpy.init(args=ros_arguments(namespace), signal_handler_options=SignalHandlerOptions.NO)
    try:
        with delivering() as delivery:
            spinner = Spinner(delivery)
            try:
                yield spinner
            finally:
                spinner.stop()
    finally:
        rclpy.try_shutdown()


def ros_arguments(namespace: str) -> list[str]:
    """Return the ROS arguments that put nodes into a namespace."""
    return ['--ros-args', '-r', f'__ns:=/{namespace}'] if namespace else []


def node_command(module: str, namespace: str = '', *parameter_files: Path) -> list[str]:
    """Return the command that runs the nodes of a module, with the parameters of files."""
    files = [word for file in parameter_files for word in ('--params-file', str(file))]
    arguments = ['--ros-args', *files, *ros_arguments(namespace)]
    return [sys.executable, '-m', module, *arguments]


def write_parameter_file(path: Path, parameters: Mapping[str, Mapping[str, object]]) -> None:
    """Write a ROS parameter file with a section for each node."""
    content = {
        f'/**/{node}': {
            'ros__parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in values.items()
            }
        }
        for node, values in parameters.items()
    }
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')


@contextmanager
def running_processes(commands: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Process]]:
    """Run commands for as long as the block lasts; SIGINT ends them, in their order."""
    started: dict[str, Process] = {}
    try:
        for name, words in commands.items():
            started[name] = subprocess.Popen(words)
        yield started
    finally:
        for process in started.values():
            process.send_signal(signal.SIGINT)
        for process in started.values():
            end_process(process)


def end_process(process: Process) -> bool:
    """Wait until a process has ended, and kill it if it does not; return whether it ended."""
    try:
        process.wait(timeout=_PROCESS_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return False
    return True
