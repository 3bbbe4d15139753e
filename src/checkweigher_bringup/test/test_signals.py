# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Signals at any time, which give the exit status and leave no process, folder or partial file."""

from collections import Counter
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import time

import pytest
from running import BAGS, PATIENCE, command_line, family

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
BAG, ITEMS = str(BAGS / 'paper_90'), 25
# Each goes on until it is ended, but for weigh.
COMMANDS = {
    'weigh': ('weigh', BAG, '--csv', 'masses.csv'),
    'simulate': (
        *('simulate', '--speed', '60', '--mass', '100', '--count', '1000000'),
        *('--output', 'simulated'),
    ),
    'replay': ('replay', BAG, '--rate', '0.5', '--csv', 'masses.csv'),
    'replay --processes': ('replay', BAG, '--rate', '0.5', '--processes'),
    'run': ('run',),
    'run --processes': ('run', '--processes'),
    'tune': (
        *('tune', BAG, str(BAGS / 'paper_60'), '--output', 'tuned.yaml'),
        *('--estimator', 'tvlpf', '--budget', '1000000', '--jobs', '2'),
    ),
    'evaluate': (
        *('evaluate', '--protocol', 'paper', '--passes', '4', '--estimator', 'tvlpf'),
        *('--budget', '1000000', '--jobs', '2', '--html', 'report.html'),
    ),
    'record': ('record', '--output', 'recorded'),
    'echo': ('echo',),
    'status': ('status',),
}
# They show what there is until they are asked to end, and recorders say that nothing came.
WITHOUT_STATUS = {'echo': {0}, 'status': {0, 1}, 'record': {0, 2}}


class Tried:
    """Command that a signal has ended, and the processes and files that are left of it."""

    def __init__(
        self, words: tuple[str, ...], folder: Path, number: int, *, delay: float = PATIENCE,
        processes: int = 100,
    ) -> None:  # fmt: skip
        """Send a signal after a delay in s, or when the command has a number of processes."""
        mark = f'CHECKWEIGHER_TEST={folder}'
        scratch = folder / 'tmp'
        scratch.mkdir()
        self.process = subprocess.Popen(
            # The tests may run under nohup, which has the command ignore SIGHUP, too.
            ['env', '--default-signal', *command_line(*words)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder,
            env={**os.environ, 'CHECKWEIGHER_TEST': str(folder), 'TMPDIR': str(scratch)},
            start_new_session=True,
        )  # fmt: skip
        end = time.monotonic() + delay
        while time.monotonic() < end and self.process.poll() is None:
            if processes < 100 and len(family(mark)) >= processes:
                break
            time.sleep(0.01)
        if self.process.poll() is None:
            self.process.send_signal(number)
        self.errors = self.process.communicate(timeout=PATIENCE)[1]
        self.status = self.process.returncode
        end = time.monotonic() + PATIENCE
        while (left := family(mark)) and time.monotonic() < end:
            time.sleep(0.05)
        self.processes = [*left.values()]
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        self.files = sorted(path.name for path in (*folder.iterdir(), *scratch.iterdir()))
        self.files.remove('tmp')
        masses = folder / 'masses.csv'
        self.rows = len(masses.read_text().splitlines()) if masses.exists() else 0


def problem(name: str, number: int, tried: Tried) -> str:
    """Return what is wrong, or an empty text."""
    expected = {128 + number, -number} | WITHOUT_STATUS.get(name, set())
    if name == 'weigh':
        expected.add(0)  # it had ended
    # A kill may leave the folder of a bag in the making, which the next writer removes.
    partial = {f for f in tried.files if f.startswith('.simulated.') and number == signal.SIGKILL}
    whole = {'masses.csv'} if tried.rows == ITEMS + 1 else set()
    if tried.status not in expected:
        return f'status {tried.status}: {tried.errors[-300:]}'
    if tried.processes:
        return f'left {tried.processes}'
    if left := set(tried.files) - partial - whole:
        return f'left {left}'
    starting = tried.status in (-number, 1)  # Python's own start
    if 'Traceback' in tried.errors and not starting:
        return tried.errors
    return ''


@pytest.mark.parametrize(
    ('name', 'number', 'processes'),
    [
        ('replay --processes', signal.SIGTERM, 6),
        ('run --processes', signal.SIGKILL, 7),
        ('run', signal.SIGHUP, 2),  # as of a terminal that is closed
        ('tune', signal.SIGKILL, 4),  # with what loky has beside its workers
        ('tune', signal.SIGINT, 4),
    ],
)
def test_every_process_ends_with_its_command(
    name: str, number: int, processes: int, tmp_path: Path
):
    tried = Tried(COMMANDS[name], tmp_path, number, processes=processes)

    assert not problem(name, number, tried)


def test_a_gateway_ends_with_a_line_that_is_killed(tmp_path: Path):
    settings = tmp_path / 'gateways.yaml'
    settings.write_text('metrics: {port: 0}')

    tried = Tried(('run', '--gateways', str(settings)), tmp_path, signal.SIGKILL, processes=3)

    assert not tried.processes


IN_A_TEXT = """
import os, signal, time
from checkweigher_bringup import cli

cli.build_parser = lambda: exec('os.kill(os.getpid(), signal.SIGTERM); time.sleep(60)')
cli.main([])
"""


def test_a_signal_is_the_status_also_where_python_executes_a_text(tmp_path: Path):
    (tmp_path / 'interrupted.py').write_text(IN_A_TEXT)
    path = os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])

    done = subprocess.run(
        [sys.executable, '-m', 'interrupted'], env={**os.environ, 'PYTHONPATH': path}, check=False
    )

    assert done.returncode == 128 + signal.SIGTERM


@pytest.mark.soak
@pytest.mark.parametrize('name', COMMANDS)
def test_nothing_is_left_by_a_signal_at_any_time(name: str, tmp_path: Path):
    chance = random.Random(name)
    outcomes: Counter[str] = Counter()
    problems = []
    for trial in range(20):
        number = NUMBERS[trial % len(NUMBERS)]
        folder = tmp_path / str(trial)
        folder.mkdir()
        delay = chance.uniform(0.05, 5.0)
        found = problem(name, number, Tried(COMMANDS[name], folder, number, delay=delay))
        outcomes['not held' if found else 'held'] += 1
        if found:
            problems.append(f'{signal.Signals(number).name} after {delay:.2f} s: {found}')
    print(f'\n{name}: {outcomes.total()} tried, {dict(outcomes)}')
    assert not problems
