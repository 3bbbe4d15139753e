# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The nodes that docs/own_driver.md and docs/own_stage.md print weigh as they are printed."""

from collections.abc import Callable, Iterator
from pathlib import Path
import re
import subprocess
import sys
import time

from checkweigher_msgs.msg import Verdict
from graph import heard
import pytest
from rclpy.node import Node
from running import PATIENCE, ROOT

from checkweigher_bringup.spinning import Spinner
from checkweigher_core.ros import ports

LANE = 'own_nodes'
NAMESPACE = f'/{LANE}'
Start = Callable[..., None]


@pytest.fixture
def start() -> Iterator[Start]:
    """Start Python with arguments, in the namespace of these tests."""
    started: list[subprocess.Popen[bytes]] = []

    def begin(*arguments: str) -> None:
        names = ['--ros-args', '-r', f'__ns:={NAMESPACE}']
        started.append(subprocess.Popen([sys.executable, *arguments, *names]))

    yield begin
    # rclpy wakes its executor before it shuts the context down. A node without timers may sleep on
    # after a signal, and ends by the next one, which `ros2 launch` sends as well.
    end = time.monotonic() + PATIENCE
    while alive := [process for process in started if process.poll() is None]:
        assert time.monotonic() < end
        for process in alive:
            process.terminate()
        time.sleep(1)


def printed(page: str, folder: Path) -> str:
    """Write the program that a page of the docs prints, and return its path."""
    code = re.search(r'```python\n(.*?)```', (ROOT / f'docs/{page}.md').read_text(), re.DOTALL)
    assert code
    path = folder / f'{page}.py'
    path.write_text(code[1])
    return str(path)


@pytest.mark.parametrize('corrected', [False, True])
def test_the_printed_nodes_weigh(tmp_path: Path, spinner: Spinner, start: Start, corrected: bool):
    node = Node('listener')
    verdicts = heard(node, ports.VERDICT)
    spinner.add(node)
    if corrected:
        start(printed('own_stage', tmp_path))
    # As line.launch.py hands it to each node.
    remap = ['--ros-args', '--remap', 'identifier:denoised_window:=corrected_window']
    for stage in ('segmenter', 'denoise', 'identifier', 'reject'):
        start('-m', f'checkweigher_dsp.nodes.{stage}', *(remap if corrected else ()))
    start(printed('own_driver', tmp_path))
    weighed: list[Verdict] = []
    while len(weighed) < 3:  # one after the other: the first ones come before all stages are there
        verdict = verdicts.get(timeout=PATIENCE)[1]
        weighed = [*weighed, verdict] if verdict.decision == Verdict.ACCEPT else []
    expected = 0.2002 if corrected else 0.2
    assert [verdict.mass for verdict in weighed] == pytest.approx(3 * [expected], abs=1e-5)
