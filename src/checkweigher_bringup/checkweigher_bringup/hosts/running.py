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
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from checkweigher_bringup.hosts.clocks import HostClocks, answering
from checkweigher_bringup.hosts.description import LineDescription, Share
from checkweigher_bringup.running_line import SupervisedProcess
from checkweigher_bringup.spinning import (
    asked_to_end,
    memory_file,
    node_command,
    spinning,
    write_parameter_file,
)
from checkweigher_bringup.supervision import CANNOT_START
from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.diagnostics import status_of
from checkweigher_dsp.ros.port_node import PortNode

_POLL_PERIOD, _CLOCK_PERIOD = 0.1, 1.0  # s
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


class _Listener(PortNode):
    """Listen to which nodes of all lanes are `alive`."""

    def __init__(self, host: str) -> None:
        super().__init__(f'supervisor_{host}')
        self.alive: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.subscribe(ports.DIAGNOSTICS, self._on_diagnostics)

    def tell_clocks(self, clocks: HostClocks) -> None:
        """Publish from now on how the clocks of the other hosts are, and log what has changed."""
        output, levels = self.output(ports.DIAGNOSTICS), dict[str, Level]()

        def tell() -> None:
            statuses = []
            for each in clocks.findings():
                if levels.get(each.aspect) != each.level:
                    say = self.get_logger().info if each.level == Level.OK else self.warn
                    say(f'{each.aspect}: {each.message}')
                levels[each.aspect] = each.level
                statuses.append(status_of(f'{self.get_name()}: {each.aspect}', each))
            message = DiagnosticArray(status=statuses)
            message.header.stamp = self.get_clock().now().to_msg()
            output.send(message)

        self.create_timer(_CLOCK_PERIOD, tell)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            self.alive.put(status.name.strip('/').partition(':')[0])


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
        node = _Listener(host)
        with _clocks(line, host) as clocks:
            if clocks is not None:
                node.tell_clocks(clocks)
            spinner.add(node)
            try:
                return _supervise(processes, process_of, node, asked)
            finally:
                for process in processes.values():
                    process.terminate()
                for process in processes.values():
                    process.wait()


@contextmanager
def _clocks(line: LineDescription, host: str) -> Iterator[HostClocks | None]:
    """Compare the clocks of the hosts that share a lane with this one, if there are any."""
    sharing = {other for lane in line.lanes if host in lane.nodes for other in lane.nodes} - {host}
    if not sharing:
        yield None
        return
    with ExitStack() as stack:
        clocks = None
        try:
            stack.enter_context(answering(line.hosts[host]))
            others = {other: line.hosts[other] for other in sorted(sharing)}
            clocks = HostClocks(line.hosts[host], others)
            stack.callback(clocks.close)
        except OSError as error:  # the lanes run all the same
            text = f'clocks are not compared: {line.hosts[host]}: {error.strerror or error}'
            print(f'{host}: {text}', file=sys.stderr, flush=True)
        yield clocks


def _supervise(
    processes: Mapping[str, SupervisedProcess], process_of: Mapping[str, SupervisedProcess],
    node: _Listener, asked: list[int],
) -> int:  # fmt: skip
    while not asked:
        now = time.monotonic()
        while not node.alive.empty():
            if (process := process_of.get(node.alive.get())) is not None:
                process.heard(now)
        if not all([process.look(now) for process in processes.values()]):
            return CANNOT_START
        time.sleep(_POLL_PERIOD)
    return 128 + asked[0]
