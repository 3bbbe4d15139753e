"""Work on several processes: its order, its errors, and what Ctrl-C does to it."""

from functools import partial
import math
import operator
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from checkweigher_validation.parallel import WorkerLostError, run_all

PATIENCE = 60.0  # s, for processes to come up on a busy machine


def task(function, *arguments):
    return SimpleNamespace(run=partial(function, *arguments))


@pytest.mark.parametrize('workers', [1, 2])
def test_results_come_in_the_order_of_the_tasks_and_progress_is_told(workers):
    told = []
    tasks = [task(operator.mul, number, 2) for number in range(5)]
    results = run_all(tasks, workers, lambda done, total: told.append((done, total)))
    assert results == [0, 2, 4, 6, 8]
    assert told == [(n, 5) for n in range(1, 6)]


def test_nothing_to_do_is_done():
    assert run_all([], 2) == []


def test_workers_are_other_processes_with_one_thread_for_matrices_each(monkeypatch):
    monkeypatch.delenv('OMP_NUM_THREADS', raising=False)
    monkeypatch.setenv('OPENBLAS_NUM_THREADS', '7')
    tasks = [
        task(os.getpid), task(os.getenv, 'OMP_NUM_THREADS'), task(os.getenv, 'OPENBLAS_NUM_THREADS')
    ]  # fmt: skip
    process, *threads = run_all(tasks, 2)
    assert process != os.getpid()
    assert threads == ['1', '1']
    assert 'OMP_NUM_THREADS' not in os.environ
    assert os.environ['OPENBLAS_NUM_THREADS'] == '7'


@pytest.mark.parametrize('workers', [1, 2])
def test_the_error_of_a_task_arrives_as_it_was_raised(workers):
    with pytest.raises(ValueError, match=r'math domain error|nonnegative'):
        run_all([task(math.sqrt, 4), task(math.sqrt, -1)], workers)


INTERRUPTED = """
from functools import partial
from pathlib import Path
import os, signal, sys, time
from types import SimpleNamespace
from checkweigher_validation.parallel import run_all

def work(folder, duration):
    Path(folder, str(os.getpid())).touch()
    while len(os.listdir(folder)) < 2:
        time.sleep(0.01)
    time.sleep(duration)
    Path(folder, 'one is idle').touch()

if __name__ == '__main__':
    # Whoever runs the tests in the background ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        run_all([SimpleNamespace(run=partial(work, sys.argv[1], d)) for d in (0.0, 600.0)], 2)
    except KeyboardInterrupt:
        sys.exit(130)
"""


def test_an_interrupt_ends_all_processes_at_once_and_without_a_word(tmp_path: Path):
    script, folder = tmp_path / 'script.py', tmp_path / 'workers'
    script.write_text(INTERRUPTED)
    folder.mkdir()
    process = subprocess.Popen(
        [sys.executable, script, folder], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    deadline = time.monotonic() + PATIENCE
    while len(list(folder.iterdir())) < 3 and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.2)  # until the one that is done waits for more
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (130, '')


def test_a_worker_that_is_killed_is_told_on_one_line():
    with pytest.raises(WorkerLostError, match='a worker process was killed'):
        run_all([task(os._exit, 9), task(os.getpid)], 2)
