# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Functions that run ROS nodes in the process of a command or in other processes."""

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

_PROCESS_PATIENCE = 5.0  # maximum time in s to wait until a process ends, before it is killed


@contextmanager
def spinning(namespace: str = '', enclave: str = '') -> Iterator[Spinner]:
    """Yield a spinner. ROS and the spinner run until the context ends.

    The nodes of this process are in `namespace`. With ROS security, the process uses the enclave
    `enclave` of this namespace, or none if `enclave` is empty. Ctrl-C raises KeyboardInterrupt
    within the context, so that the caller can finish its work while the nodes still exist. The
    nodes log only warnings and errors, because a command shows its own results.
    """
    arguments = [*ros_arguments(namespace), '--ros-args', '--log-level', 'warn']
    if enclave:
        arguments += enclave_arguments(namespace, enclave)
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        spinner = Spinner()
        stack.callback(spinner.stop)
        yield spinner


def ros_arguments(namespace: str) -> list[str]:
    """Return the ROS arguments that put nodes into a namespace, or no arguments if it is empty."""
    return ['--ros-args', '-r', f'__ns:=/{namespace}'] if namespace else []


def node_command(
    module: str, namespace: str = '', *parameter_files: Path, nodes: Sequence[str] = ()
) -> list[str]:
    """Return the command that runs the nodes of a module in a namespace with parameter files.

    If `nodes` is empty, the module runs all its nodes.
    """
    files = [word for file in parameter_files for word in ('--params-file', str(file))]
    # The enclave has the name of the node, or of the module if the module runs several nodes.
    name = {path: node for node, path in NODES.items()}.get(module, module.rpartition('.')[2])
    place = [*ros_arguments(namespace), *enclave_arguments(namespace, name)]
    return [sys.executable, '-m', module, *nodes, '--ros-args', *files, *place]


@contextmanager
def asked_to_end() -> Iterator[list[int]]:
    """Yield a list of the received signals SIGINT, SIGTERM and SIGHUP, which raise no exception.

    An exception could interrupt the writing of a message or the start of a process. Signals that
    are ignored stay ignored. When the context ends, the previous handlers are installed again.
    """
    received: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: received.append(number))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if signal.getsignal(number) != signal.SIG_IGN  # Under nohup, SIGHUP must stay ignored.
    }
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def memory_file() -> Iterator[Path]:
    """Yield the path of an empty file in memory, which other processes can open.

    The file is removed when the context ends, and also if this process is killed.
    """
    number = os.memfd_create('checkweigher')
    try:
        yield Path(f'/proc/{os.getpid()}/fd/{number}')
    finally:
        os.close(number)


def write_parameter_file(
    path: Path, parameters: Mapping[str, Mapping[str, object]], namespace: str = '**'
) -> None:
    """Write a ROS parameter file. By default, the file applies to nodes in any namespace.

    `parameters` contains the parameters by node and name. ROS groups the values of all files by the
    stated name of the node, such as ``/**/driver``, and applies the groups in the order of their
    first occurrence. A file that must override all others therefore needs the namespace, so that it
    states the full name of each node.
    """
    content = {
        f'/{namespace}/{node}'.replace('//', '/'): {
            'ros__parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in values.items()
            }
        }
        for node, values in parameters.items()
    }
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')


def start_process(words: Sequence[str]) -> Process:
    """Start a process that ends when this process ends.

    The new process does not receive Ctrl-C of the terminal. The present process receives Ctrl-C,
    and then ends its child processes in order.
    """
    return subprocess.Popen(words, env=child_environment(), process_group=0)


@contextmanager
def running_processes(commands: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Process]]:
    """Run commands until the context ends, and yield their processes by name.

    When the context ends, the processes get SIGTERM in the order of `commands`. A process that does
    not end within 5 s is killed.
    """
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
    """Wait until a process ends, and kill the process after 5 s.

    Returns False if the process was killed, otherwise True.
    """
    try:
        process.wait(timeout=_PROCESS_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return False
    return True
