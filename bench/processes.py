# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Processes of a line to be measured: started, watched and ended."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from checkweigher_bringup.spinning import write_parameter_file
from checkweigher_core.ros.ports import NODES

HERE = Path(__file__).parent
_TICKS = os.sysconf('SC_CLK_TCK')
_END_PATIENCE = 20.0  # s


@dataclass(frozen=True, slots=True)
class Usage:
    """What a process has used.

    Attributes
    ----------
    when : float
        s of the monotonic clock.
    cpu : float
        s, user and system.
    resident : int
        kB.
    """

    when: float
    cpu: float
    resident: int


class Process:
    """A child whose use of the machine can be asked for."""

    def __init__(self, command: Sequence[object]) -> None:
        self.began = time.monotonic()
        self._child = subprocess.Popen([sys.executable, *map(str, command)])

    def usage(self) -> Usage:
        """Return what it has used so far."""
        folder = Path('/proc', str(self._child.pid))
        fields = (folder / 'stat').read_text(encoding='ascii').rpartition(')')[2].split()
        status = (folder / 'status').read_text(encoding='ascii')
        resident = status.partition('VmRSS:')[2].split()[0]
        return Usage(time.monotonic(), (int(fields[11]) + int(fields[12])) / _TICKS, int(resident))

    def end(self) -> None:
        """End it and wait for that."""
        if self._child.poll() is None:
            self._child.send_signal(signal.SIGINT)
        try:
            self._child.wait(_END_PATIENCE)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


@contextmanager
def started(commands: Sequence[Sequence[object]]) -> Iterator[list[Process]]:
    """Have processes for as long as the block lasts."""
    processes: list[Process] = []
    try:
        processes += [Process(command) for command in commands]
        yield processes
    finally:
        for process in processes:
            process.end()


def line_commands(
    file: Path,
    parameters: Mapping[str, dict[str, object]],
    stamps: Path,
    *,
    one_process: bool,
    namespace: str = '',
) -> list[list[object]]:
    """Return the commands of a line whose driver notes when each edge t3 was there."""
    write_parameter_file(file, dict(parameters))
    ros = ['--ros-args', '--params-file', file, '--log-level', 'error']
    if namespace:
        ros += ['-r', f'__ns:=/{namespace}']
    driver: list[object] = [HERE / 'stamping.py', 'line' if one_process else 'driver', stamps, *ros]
    if one_process:
        return [driver]
    return [['-m', module, *ros] if name != 'driver' else driver for name, module in NODES.items()]


class Listener:
    """A node of this process, spun while something is waited for."""

    def __init__(self) -> None:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node('bench')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def spin_until(self, condition: Callable[[], bool], patience: float) -> None:
        """Spin until a condition holds; TimeoutError after `patience` s."""
        end = time.monotonic() + patience
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError(f'nothing for {patience:g} s')
            self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()


@contextmanager
def listener() -> Iterator[Listener]:
    """Have a listener for as long as the block lasts."""
    found = Listener()
    try:
        yield found
    finally:
        found.close()
