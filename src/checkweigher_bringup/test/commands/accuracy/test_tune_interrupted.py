# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tune` and `evaluate` that are interrupted, or lose a process: no traceback, no hang."""

from collections.abc import Iterator
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from lines import simulated
import pytest

from checkweigher_recording.bags.writing import write_bag

PATIENCE = 60.0  # s, on a busy machine
ENDLESS = ('--estimator', 'tvlpf', '--budget', '1000000', '--jobs', '2')
TICKS = os.sysconf('SC_CLK_TCK')  # of processor time in a second


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp('bags')
    for speed in (1.0, 1.5):
        line = simulated(speed=speed, count=6)
        write_bag(folder / f'at_{speed}', line.load_cell, line)
    return [str(bag) for bag in folder.iterdir()]


@pytest.fixture(params=['tune', 'evaluate'])
def started(
    request: pytest.FixtureRequest, bags: list[str], tmp_path: Path
) -> Iterator[subprocess.Popen[str]]:
    """Start the command in a process group of its own."""
    words = {
        'tune': ['tune', *bags, '--output', str(tmp_path / 'machine.yaml')],
        'evaluate': ['evaluate', '--protocol', 'paper', '--passes', '4'],
    }[request.param]
    process = subprocess.Popen(
        [sys.executable, '-m', 'checkweigher_bringup.cli', *words, *ENDLESS],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    yield process
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def workers(process: subprocess.Popen[str], busy: float) -> list[int]:
    """Wait for two workers of a command that have worked for so many seconds, and return them."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        found = [pid for pid in group(process) if processor_time(pid) >= busy]
        if len(found) >= 2:
            return found
        time.sleep(0.01)
    raise AssertionError('there are no two workers')


def group(process: subprocess.Popen[str]) -> list[int]:
    """Return the workers of a command that are there."""
    found = []
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            # Other processes of loky look after what killed workers leave.
            is_worker = 'loky.backend.popen' in (folder / 'cmdline').read_text()
            if is_worker and os.getpgid(int(folder.name)) == process.pid:
                found.append(int(folder.name))
        except OSError:
            continue
    return found


def processor_time(pid: int) -> float:
    """Return the processor time of a process in s, 0 if there is none."""
    try:
        fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / TICKS


@pytest.mark.parametrize('busy', [0.0, 1.0])
def test_an_interrupt_ends_it_without_a_word(started, busy, tmp_path):
    workers(started, busy)

    os.killpg(started.pid, signal.SIGINT)  # as a terminal does

    out, errors = started.communicate(timeout=PATIENCE)
    assert (started.returncode, out, errors) == (130, '', '')
    assert group(started) == []
    assert list(tmp_path.iterdir()) == []
