# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command `run`, which restarts processes that are killed or hang, so that no verdict is lost."""

from collections.abc import Iterator
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from typing import Any

from checkweigher_msgs.msg import Verdict
from processes import children
import pytest
from running import PATIENCE, run_command, start_command
from served_page import get
from supervised_line import SupervisedLine, supervised_line

from checkweigher_core.ros.ports import NODES


@pytest.fixture
def line(tmp_path: Path) -> Iterator[SupervisedLine]:
    with supervised_line(tmp_path) as running:
        yield running


def test_what_is_killed_or_hangs_comes_back_and_every_item_has_its_verdict(
    line: SupervisedLine, record_property: Any
):
    line.judge_until(Verdict.ACCEPT)
    for name, number in (('identifier', signal.SIGKILL), ('denoise', signal.SIGSTOP)):
        seconds = line.recovery(name, number)
        record_property(f'{name} {number.name}', f'{seconds:.1f} s')
        print(f'{name} {number.name}: weighed again after {seconds:.1f} s')
    line.judge_until(Verdict.ACCEPT)
    assert line.end() == 130
    line.check()
    log = line.log.read_text()
    assert 'identifier: killed by signal 9 (SIGKILL); restarted after ' in log
    assert 'denoise: hung: no diagnostics for 5 s; restarted after ' in log


def test_a_line_that_cannot_start_ends_with_its_reason(tmp_path: Path):
    done = run_command('run', '--bag', tmp_path / 'nothing')
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert 'there is no such' in line


def test_of_two_lines_that_start_at_once_one_goes_on():
    words = ('run', '--namespace', 'twice')
    runs = [start_command(*words, *more) for more in ((), ('--processes',))]
    try:
        while all(run.poll() is None for run in runs):
            time.sleep(0.05)
        refused, goes_on = sorted(runs, key=lambda run: run.poll() is None)
        assert refused.returncode == 2
        assert 'runs here already' in refused.communicate()[1].splitlines()[-1]
        assert goes_on.stdout.readline().split()[0] == 'item'
        assert 'ACCEPT' in goes_on.stdout.readline()
        # A node beside those of the line, however it is started.
        done = subprocess.run(
            [sys.executable, '-m', NODES['reject'], '--ros-args', '-r', '__ns:=/twice'],
            capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert done.returncode == 2
        assert done.stderr.count('\n') == 1
        assert '/twice/reject runs here already' in done.stderr
        goes_on.send_signal(signal.SIGINT)
        assert goes_on.wait(timeout=60) == 130
    finally:
        for run in runs:
            run.kill()
            run.communicate()


def command_of(pid: int) -> str:
    return Path(f'/proc/{pid}/cmdline').read_text(encoding='utf-8')


def test_the_page_beside_a_line_is_kept_running_and_ends_with_it(tmp_path: Path):
    environment = {**os.environ, 'XDG_CONFIG_HOME': str(tmp_path)}
    words = ('run', '--namespace', 'shown', '--page-port', 0)
    run = start_command(*words, stdout=subprocess.DEVNULL, env=environment)
    try:
        assert run.stderr is not None
        for number in (signal.SIGKILL, 0):
            said = next(line for line in run.stderr if line.startswith('page: '))
            found = re.match(r'page: http://127\.0\.0\.1:(\d+)/', said)
            assert found
            assert get(int(found[1])).status == 200
            page = next(pid for pid in children(run.pid) if '\0page\0' in command_of(pid))
            os.kill(page, number)
        run.send_signal(signal.SIGINT)
        assert run.wait(timeout=PATIENCE) == 130
        with pytest.raises(ConnectionRefusedError):
            get(int(found[1]))
    finally:
        run.kill()
        run.communicate()
