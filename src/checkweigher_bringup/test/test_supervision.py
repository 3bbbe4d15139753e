# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restart of processes that end or hang, with real processes and given times."""

from collections.abc import Iterator
import os
from pathlib import Path
import signal

from graph import wait_for
from processes import children
import pytest

from checkweigher_bringup.supervision.processes import SupervisedProcess

LIVES = 'exec sleep 1000'


class Supervised:
    """Supervised process that runs the shell command `does`."""

    def __init__(self, does: str = LIVES, *, reports: bool = True) -> None:
        self.does = does
        self._others = set(children(os.getpid()))
        self.process = SupervisedProcess('it', lambda: ['sh', '-c', self.does], reports=reports)

    @property
    def pids(self) -> set[int]:
        return set(children(os.getpid())) - self._others

    def starts(self, now: float) -> bool:
        """Return whether the process is started at a time."""
        before = self.pids
        assert self.process.look(now)
        return bool(self.pids - before)

    def ended(self, number: int = 0) -> None:
        """Wait until the process has ended, by itself or by a signal."""
        (pid,) = self.pids
        if number:
            os.kill(pid, number)
        wait_for(lambda: Path(f'/proc/{pid}/stat').read_text().split()[2] == 'Z')


@pytest.fixture
def made() -> Iterator[list[Supervised]]:
    found: list[Supervised] = []
    yield found
    for each in found:
        each.process.terminate()
        each.process.wait()


def test_a_process_that_died_is_started_again_after_the_delay(
    made: list[Supervised], capsys: pytest.CaptureFixture[str]
):
    made.append(it := Supervised())
    assert it.starts(0.0)
    it.process.heard(99.0)
    it.ended(signal.SIGKILL)
    assert not it.starts(100.0)
    assert not it.starts(100.9)
    assert it.starts(101.2)
    said = capsys.readouterr().err
    assert 'it: killed by signal 9 (SIGKILL); restarted after 1.2 s' in said


def test_one_that_dies_at_once_again_and_again_waits_longer_up_to_a_limit(made: list[Supervised]):
    made.append(it := Supervised('exit 1'))
    now, delays = 0.0, []
    assert it.starts(now)
    for _ in range(6):
        it.ended()
        begin = now = now + 0.5
        while not it.starts(now):
            now += 0.25
        delays.append(now - begin)
    assert delays == [1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    it.ended()
    assert not it.starts(now + 60.0)
    assert it.starts(now + 61.0)


@pytest.mark.parametrize('reports', [True, False])
def test_what_cannot_start_is_given_up_but_not_what_has_worked(
    made: list[Supervised], reports: bool
):
    made.append(it := Supervised('exit 2', reports=reports))
    assert it.starts(0.0)
    it.ended()
    assert not it.process.look(1.0)
    assert not it.process.look(100.0)
    made.append(it := Supervised('exit 2', reports=reports))
    assert it.starts(0.0)
    it.ended()
    it.process.heard(2.0)
    assert not it.starts(3.0 if reports else 6.0)  # without diagnostics it has lived for long
    assert it.starts(7.0)


def test_a_silent_process_is_killed_and_said_to_have_hung(
    made: list[Supervised], capsys: pytest.CaptureFixture[str]
):
    made.append(it := Supervised())
    for start in (0.0, 100.0):
        assert it.starts(start)
        assert not it.starts(start + 29.0)  # it may take its time to start
        it.process.heard(start + 29.0)
        assert not it.starts(start + 33.0)
        assert not it.starts(start + 34.5)
        it.ended()
        assert not it.starts(start + 34.7)
    assert 'it: hung: no diagnostics for 5 s; restarted' in capsys.readouterr().err


def test_diagnostics_of_a_process_that_has_ended_do_not_count_for_the_next(made: list[Supervised]):
    made.append(it := Supervised())
    assert it.starts(0.0)
    it.ended(signal.SIGSEGV)
    assert not it.starts(1.0)
    it.process.heard(1.5)
    assert it.starts(2.0)
    assert not it.starts(20.0)
    assert not it.starts(32.5)  # from here on it hangs
    it.ended()
