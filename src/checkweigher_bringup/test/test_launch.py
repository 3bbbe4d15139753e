# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Launch file, tested only with a ROS installation, because the wheels lack `ros2 launch`."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import signal
import subprocess
from urllib.request import urlopen

import pytest
from running import PATIENCE, family, free_port, wait_for

from checkweigher_core.ros.graph.place import is_held
from checkweigher_core.ros.ports import NODES

LANE = 'launched'
pytestmark = [
    pytest.mark.skipif(shutil.which('ros2') is None, reason='there is no ros2 launch'),
    pytest.mark.parametrize('one_process', ['true', 'false']),
]


@contextmanager
def launched(folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """Launch a line whose processes have the folder in their environment; give its log."""
    log = folder / 'log'
    words = ['ros2', 'launch', 'checkweigher_bringup', 'line.launch.py', f'namespace:={LANE}']
    with log.open('w') as file:
        launch = subprocess.Popen(
            [*words, *arguments],
            stdout=file,
            stderr=file,
            env={**os.environ, 'CHECKWEIGHER_TEST': str(folder)},
        )
    try:
        wait_for(lambda: all(f'[{LANE}.{name}]: ready' in log.read_text() for name in NODES))
        yield launch, log
    finally:
        launch.kill()
        launch.wait(PATIENCE)


@pytest.mark.parametrize('end', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_launch_that_ends_leaves_no_process(tmp_path: Path, one_process: str, end: int):
    gateways, port = tmp_path / 'gateways.yaml', free_port()
    gateways.write_text(f'metrics: {{port: {port}}}')
    domain = int(os.environ['ROS_DOMAIN_ID'])
    arguments = f'one_process:={one_process}', 'page:=true', f'gateways:={gateways}'
    with launched(tmp_path, *arguments) as (launch, log):
        wait_for(lambda: '[launched.segmenter]: stream ' in log.read_text())
        wait_for(lambda: 'gateway metrics: http' in log.read_text())
        assert b'checkweigher_items' in urlopen(f'http://127.0.0.1:{port}/metrics').read()
        launch.send_signal(end)
        wait_for(lambda: not family(f'CHECKWEIGHER_TEST={tmp_path}'))
        assert not any(is_held(domain, f'/{LANE}/{name}') for name in NODES)


def test_each_node_uses_its_files_in_the_folder(tmp_path: Path, one_process: str):
    folder = tmp_path / 'machine'
    arguments = f'one_process:={one_process}', 'source:=simulator', f'folder:={folder}'
    with launched(tmp_path, *arguments):
        for name in ('audit.log', 'items.numbers', 'verdicts.numbers'):
            wait_for((folder / name).exists, name)
