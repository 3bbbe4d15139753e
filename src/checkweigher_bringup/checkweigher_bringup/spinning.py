# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes beside the command that uses them: in its process, or in processes of their own."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys

import rclpy
from rclpy.signals import SignalHandlerOptions
import yaml

from checkweigher_core.parent_process import child_environment
from checkweigher_core.ros.access.enclave import enclave_arguments
from checkweigher_core.ros.ports import NODES
from checkweigher_core.ros.spinner import Spinner

Process = subprocess.Popen[bytes]

_PROCESS_PATIENCE = 5.0  # s, for a process to end by itself


@contextmanager
def spinning(namespace: str = '') -> Iterator[Spinner]:
    """Have ROS and a spinner while the block lasts; `namespace` is that of the nodes it makes.

    Signals stay with Python: Ctrl-C is a KeyboardInterrupt in the block, and what the block has
    to finish it finishes with the nodes still there.
    """
    rclpy.init(args=ros_arguments(namespace), signal_handler_options=SignalHandlerOptions.NO)
    try:
        spinner = Spinner()
        try:
            yield spinner
        finally:
            spinner.stop()
    finally:
        rclpy.try_shutdown()


def ros_arguments(namespace: str) -> list[str]:
    """Return the ROS arguments that put nodes into a namespace."""
    return ['--ros-args', '-r', f'__ns:=/{namespace}'] if namespace else []


def node_command(
    module: str, namespace: str = '', *parameter_files: Path, nodes: Sequence[str] = ()
) -> list[str]:
    """Return the command that runs the `nodes` of a module, with the parameters of files."""
    files = [word for file in parameter_files for word in ('--params-file', str(file))]
    arguments = [
        *nodes,
        '--ros-args',
        *files,
        *ros_arguments(namespace),
        *enclave_arguments(namespace, _name(module)),
    ]
    return [sys.executable, '-m', module, *arguments]


def _name(module: str) -> str:
    """Return the name of what a module runs: a node, or a process of several."""
    return {module: node for node, module in NODES.items()}.get(module, module.rpartition('.')[2])


@contextmanager
def asked_to_end() -> Iterator[list[int]]:
    """Have a list of the signals that ask for the end come, in place of a KeyboardInterrupt.

    That would break into the writing of a message, or into the start of a process.
    """
    came: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: came.append(number))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if signal.getsignal(number) != signal.SIG_IGN  # as nohup has it
    }
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def memory_file() -> Iterator[Path]:
    """Have an empty file in memory, under a name that other processes can open.

    It is gone with this process, however that ends.
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
    """Start nodes in a process that ends with this one.

    Signals of the terminal reach this process alone, which ends the others in order. It does so by
    SIGTERM: an import that SIGINT breaks into ends with a traceback.
    """
    return subprocess.Popen(words, env=child_environment(), process_group=0)


@contextmanager
def running_processes(commands: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Process]]:
    """Run commands for as long as the block lasts; SIGTERM ends them, in their order."""
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
    """Wait until a process has ended, and kill it if it does not; return whether it ended."""
    try:
        process.wait(timeout=_PROCESS_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return False
    return True
