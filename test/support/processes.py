"""Nodes in processes of their own, as a line runs them."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
import signal
import subprocess
import sys

from running import PATIENCE

from checkweigher_bringup.replaying import write_parameter_file
from checkweigher_bringup.spinning import ros_arguments

LINE = 'checkweigher_bringup.line'

Values = Mapping[str, Mapping[str, object]]
Process = subprocess.Popen[bytes]


def command(module: str, parameters: Path | None = None, namespace: str = '') -> list[str]:
    """Return the command that runs a node, or the whole line, in a lane."""
    arguments = ros_arguments(namespace) or ['--ros-args']
    if parameters is not None:
        arguments += ['--params-file', str(parameters)]
    return [sys.executable, '-m', module, *arguments]


def parameter_file(path: Path, values: Values) -> Path:
    """Write the parameters of some nodes to a file and return its path."""
    write_parameter_file(path, {node: dict(own) for node, own in values.items()})
    return path


@contextmanager
def started(commands: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Process]]:
    """Run commands for as long as the block lasts; none of them is left behind."""
    processes: dict[str, Process] = {}
    try:
        for name, words in commands.items():
            processes[name] = subprocess.Popen(words)
        yield processes
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGINT)
        for process in processes.values():
            try:
                process.wait(timeout=PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def children(pid: int) -> list[int]:
    """Return the processes that a process has started and that have not ended."""
    threads = Path(f'/proc/{pid}/task').iterdir()
    return [int(child) for path in threads for child in (path / 'children').read_text().split()]
