# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Launch file, tested only with a ROS installation, because the wheels lack `ros2 launch`."""

import os
from pathlib import Path
import shutil
import signal
import subprocess

import pytest
from running import PATIENCE, wait_for

from checkweigher_core.ros.graph.place import is_held
from checkweigher_core.ros.ports import NODES

LANE = 'launched'
pytestmark = pytest.mark.skipif(shutil.which('ros2') is None, reason='there is no ros2 launch')


@pytest.mark.parametrize('end', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize('one_process', ['true', 'false'])
def test_a_launch_that_ends_leaves_nobody_in_the_places_of_the_line(
    tmp_path: Path, one_process: str, end: int
):
    log = tmp_path / 'log'
    words = (
        f'launch checkweigher_bringup line.launch.py namespace:={LANE} one_process:={one_process}'
    )
    domain = int(os.environ['ROS_DOMAIN_ID'])
    with log.open('w') as file:
        launch = subprocess.Popen(['ros2', *words.split()], stdout=file, stderr=file)
    try:
        wait_for(lambda: all(is_held(domain, f'/{LANE}/{name}') for name in NODES))
        wait_for(lambda: all(f'[{LANE}.{name}]: ready' in log.read_text() for name in NODES))
        wait_for(lambda: '[launched.segmenter]: stream ' in log.read_text())
        launch.send_signal(end)
        wait_for(lambda: not any(is_held(domain, f'/{LANE}/{name}') for name in NODES))
    finally:
        launch.kill()
        launch.wait(PATIENCE)
