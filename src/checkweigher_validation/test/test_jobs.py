# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Jobs in several processes: their order, errors, progress bar, and the effect of Ctrl-C."""

from functools import partial
import math
import operator
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

import pytest
from running import PATIENCE, wait_for

from checkweigher_recording import progress
from checkweigher_validation.jobs import WorkerLostError, jobs_as_done, run_jobs


@pytest.mark.parametrize('n_jobs', [1, 2])
def test_results_come_in_the_order_of_the_calls_or_with_their_numbers(n_jobs):
    calls = [partial(operator.mul, number, 2) for number in range(5)]
    assert run_jobs(calls, n_jobs) == [0, 2, 4, 6, 8]
    assert sorted(jobs_as_done(calls, n_jobs)) == [(n, 2 * n) for n in range(5)]
    assert list(jobs_as_done([], n_jobs)) == []


@pytest.mark.parametrize('n_jobs', [1, 2])
def test_a_bar_on_a_terminal_says_what_is_done_to_its_end(monkeypatch, capsys, n_jobs):
    monkeypatch.setattr(sys.stderr, 'isatty', lambda: True)
    monkeypatch.setattr(progress, '_DELAY', 0.0)
    run_jobs([partial(time.sleep, 0.15)] * 5, n_jobs, 'tuning')
    shown = capsys.readouterr().err
    assert 'tuning:   0%' in shown
    assert 'tuning: 100%' in shown


def test_the_bar_of_unequal_jobs_advances_by_their_sizes(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, 'isatty', lambda: True)
    monkeypatch.setattr(progress, '_DELAY', 0.0)
    run_jobs([partial(time.sleep, 0.15)] * 3, 1, 'tuning', [12, 6, 2])
    shown = re.findall(r'tuning: +(\d+)%', capsys.readouterr().err)
    assert shown == ['0', '60', '90', '100']


def test_workers_are_other_processes_with_one_thread_for_matrices_each(monkeypatch, capfd):
    monkeypatch.delenv('OMP_NUM_THREADS', raising=False)
    monkeypatch.setenv('OPENBLAS_NUM_THREADS', '7')
    names = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS')
    process, *threads = run_jobs([os.getpid, *(partial(os.getenv, n) for n in names)], 2)
    assert process != os.getpid()
    assert threads == ['1', '1']
    assert 'OMP_NUM_THREADS' not in os.environ
    assert os.environ['OPENBLAS_NUM_THREADS'] == '7'
    assert capfd.readouterr().err == ''  # without a terminal there is no bar


@pytest.mark.parametrize('n_jobs', [1, 2])
def test_the_error_of_a_call_arrives_as_it_was_raised(n_jobs):
    with pytest.raises(ValueError, match=r'math domain error|nonnegative'):
        run_jobs([partial(math.sqrt, 4), partial(math.sqrt, -1)], n_jobs)


INTERRUPTED = """
from functools import partial
from pathlib import Path
import os, signal, sys, time
from checkweigher_validation.jobs import run_jobs

def work(folder, duration):
    Path(folder, str(os.getpid())).touch()
    while len(os.listdir(folder)) < 2:
        time.sleep(0.01)
    time.sleep(duration)
    Path(folder, 'one is idle').touch()

if __name__ == '__main__':
    # A shell that runs the tests in the background has them ignore it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        run_jobs([partial(work, sys.argv[1], duration) for duration in (0.0, 600.0)], 2)
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.parametrize(('when', 'files'), [('one begins', 1), ('one is idle', 3)])
def test_an_interrupt_ends_all_processes_at_once_and_without_a_word(tmp_path: Path, when, files):
    script, folder = tmp_path / 'script.py', tmp_path / 'workers'
    script.write_text(INTERRUPTED)
    folder.mkdir()
    process = subprocess.Popen(
        [sys.executable, script, folder], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    wait_for(lambda: len(list(folder.iterdir())) >= files)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (130, '')


DIES_ONCE = """
import os, pathlib, signal
if not pathlib.Path({path!r}).exists():
    pathlib.Path({path!r}).touch()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize('others', [1, 40])
def test_the_calls_of_a_worker_that_is_killed_are_made_again(tmp_path: Path, others: int):
    script = DIES_ONCE.format(path=str(tmp_path / 'died'))
    calls = [partial(operator.neg, 1), partial(exec, script), *[partial(operator.neg, 2)] * others]
    assert sorted(jobs_as_done(calls, 2)) == [(0, -1), (1, None)] + [
        (2 + number, -2) for number in range(others)
    ]
    assert (tmp_path / 'died').exists()


@pytest.mark.parametrize('others', [0, 2, 40])
def test_a_call_that_kills_each_process_is_named_and_the_others_are_made(others: int):
    calls = [partial(os._exit, 9), *[partial(operator.neg, 2)] * others, partial(os._exit, 9)]

    done = dict(jobs_as_done(calls, 2))

    assert sorted(done) == list(range(len(calls)))
    for number in (0, len(calls) - 1):
        assert isinstance(done.pop(number), WorkerLostError)
    assert list(done.values()) == [-2] * others
    with pytest.raises(WorkerLostError, match='the job killed its worker, and again when'):
        run_jobs(calls, 2)
    assert run_jobs([partial(operator.neg, 1), partial(operator.neg, 2)], 2) == [-1, -2]
