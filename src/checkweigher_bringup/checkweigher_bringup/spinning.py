# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes of a command, in its own process or in other processes."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys

import rclpy
from rclpy.signals import SignalHandlerOptions
import yaml

from checkweigher_core.parent_process import child_environment
from checkweigher_core.ros.graph.policy import enclave_arguments
from checkweigher_core.ros.ports import NODES
from checkweigher_core.ros.spinner import Spinner

Process = subprocess.Popen[bytes]

_PROCESS_PATIENCE = 5.0  # s, for a process to end by itself


@contextmanager
def spinning(namespace: str = '') -> Iterator[Spinner]:
    """Run ROS and a spinner during a block; nodes made in the block are in `namespace`.

    Python handles the signals: Ctrl-C raises KeyboardInterrupt in the block, which can finish its
    work while the nodes still exist. The nodes log warnings only, because a command shows its
    results itself.
    """
    arguments = [*ros_arguments(namespace), '--ros-args', '--log-level', 'warn']
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        spinner = Spinner()
        stack.callback(spinner.stop)
        yield spinner


def ros_arguments(namespace: str) -> list[str]:
    """Return the ROS arguments that put nodes into a namespace."""
    return ['--ros-args', '-r', f'__ns:=/{namespace}'] if namespace else []


def node_command(
    module: str, namespace: str = '', *parameter_files: Path, nodes: Sequence[str] = ()
) -> list[str]:
    """Return the command that runs the `nodes` of a module, with parameter files."""
    files = [word for file in parameter_files for word in ('--params-file', str(file))]
    # Name of the node, or of the process if it runs several nodes.
    name = {path: node for node, path in NODES.items()}.get(module, module.rpartition('.')[2])
    place = [*ros_arguments(namespace), *enclave_arguments(namespace, name)]
    return [sys.executable, '-m', module, *nodes, '--ros-args', *files, *place]


@contextmanager
def asked_to_end() -> Iterator[list[int]]:
    """Collect the signals that ask for the end in a list, without a KeyboardInterrupt.

    A KeyboardInterrupt could interrupt the writing of a message or the start of a process.
    """
    came: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: came.append(number))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if signal.getsignal(number) != signal.SIG_IGN  # under nohup
    }
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def memory_file() -> Iterator[Path]:
    """Yield the path of an empty file in memory, which other processes can open.

    The file ends with this process, even if the process is killed.
    """
    number = os.memfd_create('checkweigher')
    try:
        yield Path(f'/proc/{os.getpid()}/fd/{number}')
    finally:
        os.close(number)


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


def start_process(words: Sequence[str]) -> Process:
    """Start a process of nodes, which ends with this process.

    Signals of the terminal reach only this process, which then ends the others in order. It uses
    SIGTERM, because SIGINT during an import would print a traceback.
    """
    return subprocess.Popen(words, env=child_environment(), process_group=0)


@contextmanager
def running_processes(commands: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Process]]:
    """Run commands during a block, then end them by SIGTERM in the same order."""
    started: dict[str, Process] = {}
    try:
        for name, words in commands.items():
            started[name] = start_process(words)
        yield started
    finally:
        for process in started.values():
            process.terminate()
        for process in started.values():
            end_process(process)


def end_process(process: Process) -> bool:
    """Wait for a process to end; kill it after a while, and return false."""
    try:
        process.wait(timeout=_PROCESS_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return False
    return True
