"""`run` with real processes: what is killed or hangs comes back, and no item goes unjudged."""

from collections.abc import Iterator
import os
from pathlib import Path
import queue
import signal
import subprocess
import sys
import time
from typing import Any

from checkweigher_msgs.msg import Verdict
import pytest
from rclpy.node import Node
from running import run_command
from test_lifecycle import assert_one_verdict_each
from test_reject_graph import heard

from checkweigher_bringup.running_line import MODULES
from checkweigher_bringup.spinning import spinning
from checkweigher_dsp.records import NANOSECONDS
from checkweigher_dsp.ros import ports

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


class RunningLine:
    """A line under `run`, and somebody who listens to it."""

    def __init__(self, folder: Path, listener: Node) -> None:
        self.verdicts = heard(listener, ports.VERDICT, latched=True)
        self.edges = heard(listener, ports.PHOTO_EYES)
        self.found: list[Any] = []
        parameters = folder / 'line.yaml'
        parameters.write_text(PARAMETERS, encoding='utf-8')
        self.log = folder / 'log'
        with self.log.open('w', encoding='utf-8') as file:
            self.command = subprocess.Popen(
                [
                    *(sys.executable, '-m', 'checkweigher_bringup.cli', 'run', '--processes'),
                    *('--namespace', 'running', '--params', str(parameters)),
                ],
                stdout=file,
                stderr=file,
            )

    def pid(self, name: str) -> int:
        """Return the process of a node."""
        for pid in self.children():
            if MODULES[name] in Path(f'/proc/{pid}/cmdline').read_text(encoding='utf-8'):
                return pid
        raise AssertionError(f'{name} does not run\n{self.log.read_text()}')

    def children(self) -> list[int]:
        path = Path(f'/proc/{self.command.pid}/task')
        return [int(p) for t in path.iterdir() for p in (t / 'children').read_text().split()]

    def judge_until(self, decision: int, timeout: float = 60.0) -> int:
        """Collect verdicts until one of a decision comes; return when that was, ns."""
        end = time.monotonic() + timeout
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
        children = self.children()
        self.command.send_signal(signal.SIGINT)
        status = self.command.wait(timeout=60)
        assert not [pid for pid in children if Path(f'/proc/{pid}').exists()]
        return status


@pytest.fixture
def line(tmp_path: Path) -> Iterator[RunningLine]:
    with spinning('running') as spinner:
        listener = Node('listener')
        running = RunningLine(tmp_path, listener)
        spinner.add(listener)
        try:
            yield running
        finally:
            if running.command.poll() is None:
                running.command.terminate()
                running.command.wait(timeout=60)


def test_what_is_killed_or_hangs_comes_back_and_every_item_has_its_verdict(
    line: RunningLine, record_property: Any
):
    line.judge_until(Verdict.ACCEPT)
    line.found.clear()  # with lossless: false, items pass before the line is there
    for name, number in (('identifier', signal.SIGKILL), ('denoise', signal.SIGSTOP)):
        seconds = line.recovery(name, number)
        record_property(f'{name} {number.name}', f'{seconds:.1f} s')
        print(f'{name} {number.name}: weighed again after {seconds:.1f} s')
    line.judge_until(Verdict.ACCEPT)
    assert line.end() == 130
    line.check()
    log = line.log.read_text()
    assert 'identifier: killed by signal 9 (SIGKILL); started again after ' in log
    assert 'denoise: hung: no diagnostics for 5 s; started again after ' in log


def test_a_line_that_cannot_start_ends_with_its_reason(tmp_path: Path):
    done = run_command('run', '--bag', tmp_path / 'nothing')
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert 'there is no such' in line
