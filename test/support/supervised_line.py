# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A line under the command `run`, in one process or in one for each node."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import queue
import signal
import time
from typing import Any

from checkweigher_msgs.msg import Verdict
from graph import call, heard
from processes import pids_of
from rclpy.node import Node
from running import PATIENCE, children, start_command
from verdicts import assert_one_verdict_each

from checkweigher_bringup.spinning import Spinner, spinning
from checkweigher_core.records import NANOSECONDS
from checkweigher_core.ros import ports

PARAMETERS = """
/**/driver:
  ros__parameters:
    simulator.count: 0
    simulator.spacing: 0.5
    lossless: false
/**/reject:
  ros__parameters:
    rejector_distance: 1.0
"""


class SupervisedLine:
    """A line under `run`, and what a listener has heard of it."""

    def __init__(
        self,
        folder: Path,
        listener: Node,
        spinner: Spinner,
        more: str,
        *,
        processes: bool,
        machine: Path | None,
    ) -> None:
        self.listener, self.spinner = listener, spinner
        self.verdicts = heard(listener, ports.VERDICT, latched=True)
        self.edges = heard(listener, ports.PHOTO_EYES)
        self.found: list[Any] = []
        parameters = folder / 'line.yaml'
        parameters.write_text(PARAMETERS + more, encoding='utf-8')
        self.log = folder / 'log'
        with self.log.open('w', encoding='utf-8') as file:
            self.command = start_command(
                *('run', '--namespace', 'running', '--params', parameters),
                *(['--processes'] if processes else []),
                *([] if machine is None else ['--folder', machine]),
                stdout=file,
                stderr=file,
            )

    def pid(self, name: str) -> int:
        """Return the process of a node, or of the whole `line`."""
        found = pids_of(self.command.pid, name)
        assert found, f'{name} does not run\n{self.log.read_text()}'
        return found[0]

    def call(self, kind: Any, name: str, /, **request: object) -> Any:
        """Call a service of the line."""
        return call(self.listener, kind, name, **request)

    def judge_until(self, decision: int) -> int:
        """Collect verdicts until one of a decision comes; return when that was, ns."""
        end = time.monotonic() + PATIENCE
        while True:
            try:
                came, verdict = self.verdicts.get(timeout=max(0.1, end - time.monotonic()))
            except queue.Empty:
                raise AssertionError(self.log.read_text()) from None
            self.found.append(verdict)
            if verdict.decision == decision:
                return came

    def recovery(self, name: str, number: int) -> float:
        """Send a signal to a node and return after how many s an item is weighed again."""
        sent = time.monotonic_ns()
        os.kill(self.pid(name), number)
        self.judge_until(Verdict.FAULT)
        return (self.judge_until(Verdict.ACCEPT) - sent) / NANOSECONDS

    def check(self) -> None:
        """Check that each item has one verdict and is a FAULT where it has no mass."""
        while not self.verdicts.empty():  # those on their way when it ended
            self.found.append(self.verdicts.get()[1])
        assert_one_verdict_each(self.edges, self.found)
        for verdict in self.found:
            assert verdict.decision in (Verdict.ACCEPT, Verdict.FAULT)
            assert bool(verdict.reasons) == (verdict.decision == Verdict.FAULT)

    def end(self) -> int:
        """Interrupt the command and return its status; nothing may be left."""
        left = children(self.command.pid)
        self.command.send_signal(signal.SIGINT)
        status = self.command.wait(timeout=60)
        assert not [pid for pid in left if Path(f'/proc/{pid}').exists()]
        return status


@contextmanager
def supervised_line(
    folder: Path, more: str = '', *, processes: bool = True, machine: Path | None = None
) -> Iterator[SupervisedLine]:
    """Run a line, with more parameters or the folder of a machine, during the block."""
    with spinning('running') as spinner:
        listener = Node('listener')
        line = SupervisedLine(folder, listener, spinner, more, processes=processes, machine=machine)
        spinner.add(listener)
        try:
            yield line
        finally:
            if line.command.poll() is None:
                line.command.terminate()
                line.command.wait(timeout=60)
