# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""`run` with real processes: what is killed or hangs comes back, and no item goes unjudged."""

from collections.abc import Iterator
from pathlib import Path
import signal
from typing import Any

from checkweigher_msgs.msg import Verdict
import pytest
from running import run_command
from supervised_line import SupervisedLine, supervised_line


@pytest.fixture
def line(tmp_path: Path) -> Iterator[SupervisedLine]:
    with supervised_line(tmp_path) as running:
        yield running


def test_what_is_killed_or_hangs_comes_back_and_every_item_has_its_verdict(
    line: SupervisedLine, record_property: Any
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
