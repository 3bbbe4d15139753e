"""What happens to processes beside this one when it is interrupted or killed."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

from checkweigher_dsp.side_processes import ALONE, SideProcesses

PATIENCE = 60.0  # s, for processes to come up and to end on a busy machine
SCRIPT = """
import os, signal, sys, time
from checkweigher_dsp.side_processes import SideProcesses

def work(file, duration):
    with open(file + '.part', 'w') as written:
        written.write(str(os.getpid()))
    os.rename(file + '.part', file)
    time.sleep(duration)

if __name__ == '__main__':
    # Whoever runs the tests in the background ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    begun, working = sys.argv[1:]
    try:
        with SideProcesses(1, ('numpy',)) as processes:
            call = processes.submit(work, working, 600.0)
            work(begun, 0.0)
            call.result()
    except KeyboardInterrupt:
        sys.exit(130)
"""


def _wait_for(file, process):
    deadline = time.monotonic() + PATIENCE
    while not file.exists() and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.01)


def _is_running(pid):
    try:
        return 'Z' not in Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except OSError:
        return False


@pytest.fixture
def started(tmp_path):
    (tmp_path / 'script.py').write_text(SCRIPT)
    files = tmp_path / 'begun', tmp_path / 'working'
    process = subprocess.Popen(
        [sys.executable, tmp_path / 'script.py', *files],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    yield process, *files
    if process.poll() is None:
        process.kill()
    process.communicate(timeout=PATIENCE)


@pytest.mark.parametrize('when', ['it begins', 'it works'])
def test_an_interrupt_ends_both_without_a_word(started, when):
    process, begun, working = started
    _wait_for(begun if when == 'it begins' else working, process)

    os.killpg(process.pid, signal.SIGINT)  # as a terminal does

    _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (130, '')


def test_a_process_ends_with_the_one_that_started_it(started):
    process, _, working = started
    _wait_for(working, process)
    pid = int(working.read_text())
    assert _is_running(pid)

    process.kill()

    deadline = time.monotonic() + PATIENCE
    while _is_running(pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not _is_running(pid)


def test_without_any_nothing_is_started():
    before = set(os.listdir('/proc/self/task'))

    with SideProcesses(0, ('numpy',)) as processes:
        assert processes.count == ALONE.count == 0
        assert set(os.listdir('/proc/self/task')) == before


def test_a_function_is_called_whose_module_is_not_imported_here():
    assert 'colorsys' not in sys.modules

    with SideProcesses(1) as processes:
        call = processes.submit_by_name('colorsys', 'rgb_to_hsv', 1.0, 0.0, 0.0)
        assert call.result(PATIENCE) == (0.0, 1.0, 1.0)

    assert 'colorsys' not in sys.modules


def test_threads_take_turns_as_before_when_the_processes_have_ended():
    before = sys.getswitchinterval()

    with SideProcesses(1):
        assert sys.getswitchinterval() < before

    assert sys.getswitchinterval() == before
