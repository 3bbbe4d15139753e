# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The share that a host has of a line over several hosts, under supervision."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
import os
from pathlib import Path
import queue
import sys
import time

from checkweigher_bringup.hosts.description import LineDescription, Share
from checkweigher_bringup.hosts.supervisor import Supervisor, comparing_clocks
from checkweigher_bringup.running_line import SupervisedProcess
from checkweigher_bringup.spinning import (
    asked_to_end,
    memory_file,
    node_command,
    spinning,
    write_parameter_file,
)
from checkweigher_bringup.supervision import CANNOT_START

_POLL_PERIOD = 0.1  # s
_MODULE = 'checkweigher_bringup.line'


def share_command(share: Share, *files: Path) -> list[str]:
    """Return the command that runs a share in one process, with further parameter files."""
    command = node_command(_MODULE, share.lane, *share.params, *files)
    begin = command.index('--ros-args')
    return [*command[:begin], *share.nodes, *command[begin:]]


@contextmanager
def _commands(shares: Sequence[Share]) -> Iterator[dict[str, list[str]]]:
    """Have the commands of shares, with the files of their own parameters, by name."""
    with ExitStack() as stack:
        found = {}
        for share in shares:
            file = stack.enter_context(memory_file())
            write_parameter_file(file, {'product': share.product})
            found[share.name] = share_command(share, file)
        yield found


def run_host(line: LineDescription, host: str) -> int:
    """Run what a host has of a line until a signal asks for its end; return the exit status."""
    shares = line.shares(host)
    os.environ.update(line.environment())
    with _commands(shares) as commands, asked_to_end() as asked, spinning() as spinner:
        processes = {
            name: SupervisedProcess(name, partial(list, command))
            for name, command in commands.items()
        }
        # A process that hangs says nothing for any of its nodes.
        process_of = {f'{s.lane}/{node}': processes[s.name] for s in shares for node in s.nodes}
        print(f'{host}: {", ".join(processes) or "nothing to run"}', file=sys.stderr, flush=True)
        node, alive = Supervisor(host), queue.SimpleQueue[str]()
        node.hear_nodes(alive.put)
        with comparing_clocks(line, host, node):
            spinner.add(node)
            try:
                return _supervise(processes, process_of, alive, asked)
            finally:
                for process in processes.values():
                    process.terminate()
                for process in processes.values():
                    process.wait()


def _supervise(
    processes: Mapping[str, SupervisedProcess], process_of: Mapping[str, SupervisedProcess],
    alive: 'queue.SimpleQueue[str]', asked: list[int],
) -> int:  # fmt: skip
    while not asked:
        now = time.monotonic()
        while not alive.empty():
            if (process := process_of.get(alive.get())) is not None:
                process.heard(now)
        if not all([process.look(now) for process in processes.values()]):
            return CANNOT_START
        time.sleep(_POLL_PERIOD)
    return 128 + asked[0]
