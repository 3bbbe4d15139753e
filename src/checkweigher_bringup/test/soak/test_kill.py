# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Kill and stop of each of the six nodes while products pass, for some minutes."""

from collections.abc import Iterator
import os
from pathlib import Path
import signal
import time
from typing import Any

from checkweigher_msgs.msg import Verdict
import pytest
from running import wait_for
from supervised_line import SupervisedLine, supervised_line
from verdicts import entered

from checkweigher_core.records import NANOSECONDS
from checkweigher_core.ros.conversion import stamp_from
from checkweigher_core.ros.ports import NODES

pytestmark = pytest.mark.soak


@pytest.fixture
def line(tmp_path: Path) -> Iterator[SupervisedLine]:
    with supervised_line(tmp_path) as running:
        yield running


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP], ids=lambda n: n.name)
@pytest.mark.parametrize('name', NODES)
def test_every_item_has_one_verdict_whichever_node_dies(
    line: SupervisedLine, name: str, number: signal.Signals, record_property: Any
):
    line.judge_until(Verdict.ACCEPT)
    line.judge_until(Verdict.ACCEPT)
    victim = line.pid(name)
    sent = time.monotonic_ns()
    os.kill(victim, number)
    if name in ('product', 'driver'):  # without whom no item need be a FAULT
        wait_for(lambda: not Path(f'/proc/{victim}').exists(), 'the end of the process')
    else:
        line.judge_until(Verdict.FAULT)
    seconds = (line.judge_until(Verdict.ACCEPT) - sent) / NANOSECONDS
    for _ in range(5):
        line.judge_until(Verdict.ACCEPT)
    faults = sum(verdict.decision == Verdict.FAULT for verdict in line.found)
    record_property(f'{name} {number.name}', f'{seconds:.1f} s, {faults} FAULT')
    print(f'{name} {number.name}: weighed again after {seconds:.1f} s; {faults} FAULT')
    assert line.end() == 130
    assert len({verdict.item_id for verdict in line.found}) == len(line.found)
    starts = entered(line.edges)
    judged = _streams([stamp_from(verdict.t1) for verdict in line.found], starts[0])
    streams = _streams(starts, starts[0])
    assert len(streams) == len(judged) == (2 if name == 'driver' else 1)
    for items, verdicts in zip(streams, judged, strict=True):
        last = items[-1] if verdicts is not judged[-1] else max(verdicts)
        assert sorted(verdicts) == [t1 for t1 in items if min(verdicts) <= t1 <= last]


def _streams(stamps: list[int], first: int) -> list[list[int]]:
    """Split items at the start of a restarted simulation, which has the same stamps."""
    begins = [n for n, stamp in enumerate(stamps) if n > 0 and stamp == first]
    return [stamps[i:j] for i, j in zip([0, *begins], [*begins, None], strict=True)]
