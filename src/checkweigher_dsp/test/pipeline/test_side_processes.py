"""What happens to processes beside this one when it is interrupted or killed."""

from concurrent.futures import BrokenExecutor
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

import pytest

from checkweigher_dsp.pipeline.side_processes import ALONE, SideProcesses

PATIENCE = 60.0  # s, for processes to come up and to end on a busy machine
SCRIPT = """
import importlib, os, signal, sys, time
from checkweigher_dsp.pipeline.side_processes import SideProcesses

def work(file, duration):
    with open(file + '.part', 'w') as written:
        written.write(str(os.getpid()))
    os.rename(file + '.part', file)
    time.sleep(duration)

if __name__ == '__main__':
    # Whoever runs the tests in the background ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    begun, working, *modules = sys.argv[1:]
    for name in modules:
        importlib.import_module(name)
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


@pytest.fixture(params=[(), ('numpy',)], ids=['forked', 'fresh'])
def started(request, tmp_path):
    (tmp_path / 'script.py').write_text(SCRIPT)
    files = tmp_path / 'begun', tmp_path / 'working'
    process = subprocess.Popen(
        [sys.executable, tmp_path / 'script.py', *files, *request.param],
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


@pytest.mark.parametrize(('modules', 'forked'), [('', True), ('numpy', False), ('rclpy', False)])
def test_only_a_process_without_threads_of_its_own_is_forked(modules, forked):
    script = f"""
from checkweigher_dsp.pipeline.side_processes import SideProcesses
{modules and f'import {modules}'}
with SideProcesses(1) as processes:
    print(processes.submit_by_name('multiprocessing', 'get_start_method').result())
"""
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True)

    assert done.stdout.strip() == ('fork' if forked else 'spawn'), done.stderr


class Fuse:
    """Ends its process a moment after it was pickled."""

    def __reduce__(self):
        threading.Timer(0.005, os._exit, (9,)).start()
        return int, ()


def _large_and_lost():
    return bytes(1 << 26), Fuse()


def test_one_that_dies_while_it_hands_over_a_result_leaves_nobody_waiting():
    with SideProcesses(1) as processes:
        lost = processes.submit(_large_and_lost)
        with pytest.raises(BrokenExecutor):
            lost.result(PATIENCE)
        with pytest.raises(BrokenExecutor):
            processes.submit(os.getpid).result(PATIENCE)


def test_what_a_call_raises_arrives_with_where_it_was_raised():
    with SideProcesses(1) as processes:
        call = processes.submit_by_name('math', 'sqrt', -1.0)
        unknown = processes.submit_by_name('math', 'no_such_function')

        with pytest.raises(ValueError, match=r'math domain error|nonnegative') as caught:
            call.result(PATIENCE)
        with pytest.raises(AttributeError):
            unknown.result(PATIENCE)
    assert 'import_module' in caught.value.__notes__[0]


@pytest.mark.parametrize('ahead', [1, 2])
def test_many_calls_of_two_processes_have_each_its_own_result(ahead):
    with SideProcesses(2, ahead=ahead) as processes:
        calls = [processes.submit(divmod, number, 7) for number in range(200)]
        cannot_be_pickled = processes.submit(lambda: None)

        assert [call.result(PATIENCE) for call in calls] == [divmod(n, 7) for n in range(200)]
        assert cannot_be_pickled.exception(PATIENCE) is not None


def test_at_the_end_what_nobody_has_begun_is_not_done():
    with SideProcesses(1) as processes:
        calls = [processes.submit(time.sleep, 600.0) for _ in range(3)]

    assert isinstance(calls[-1].exception(PATIENCE), BrokenExecutor)
