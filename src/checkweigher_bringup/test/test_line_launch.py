# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Launch files, tested with launch_testing, which only a ROS installation has."""

import os
import signal
import unittest

import pytest
from running import PATIENCE, wait_for

from checkweigher_core.ros.ports import NODES

launch_testing = pytest.importorskip('launch_testing')

from ament_index_python.packages import get_package_share_path  # noqa: E402
from launch import LaunchDescription  # noqa: E402
from launch.actions import IncludeLaunchDescription, SetLaunchConfiguration  # noqa: E402
from launch_testing.actions import ReadyToTest  # noqa: E402
from launch_testing.asserts import assertExitCodes  # noqa: E402

LANE = 'by_launch'
KILLED = 'line', 'denoise'  # the process of the node denoise
# Packages with their launch files and arguments.
LINES = {
    'one process': ('bringup', 'line', {'one_process': 'true'}),
    'one process each': ('bringup', 'line', {'one_process': 'false'}),
    'released packages': ('driver', 'weighing', {}),
}


@pytest.mark.launch_test
@launch_testing.parametrize('line', LINES)
def generate_test_description(line):
    """Return a simulated line, and its name for the tests."""
    package, file, arguments = LINES[line]
    share = get_package_share_path(f'checkweigher_{package}')
    config = get_package_share_path('checkweigher_bringup') / 'config' / 'line.yaml'
    arguments = {'params_file': str(config), 'namespace': LANE, **arguments}
    included = IncludeLaunchDescription(
        str(share / 'launch' / f'{file}.launch.py'), launch_arguments=arguments.items()
    )
    # Launch would kill what takes 5 s to end, as six processes on a busy machine do.
    patience = SetLaunchConfiguration('sigterm_timeout', str(PATIENCE))
    return LaunchDescription([patience, included, ReadyToTest()]), {'line': line}


class TestLine(unittest.TestCase):
    def test_it_is_ready_and_begins_a_stream(self, proc_output):
        for name in NODES:
            proc_output.assertWaitFor(f'[{LANE}.{name}]: ready', timeout=PATIENCE)
        for name in ('driver', 'reject'):
            proc_output.assertWaitFor(f'[{LANE}.{name}]: active', timeout=PATIENCE)
        proc_output.assertWaitFor('segmenter]: stream ', timeout=PATIENCE)

    def test_what_ends_is_started_again(self, proc_info, proc_output):
        def starts():
            return sum(event.text.count(b'denoise]: ready') for event in proc_output)

        wait_for(lambda: starts() == 1)
        (name,) = (each for each in proc_info.process_names() if each.startswith(KILLED))
        os.kill(proc_info[name].pid, signal.SIGKILL)
        wait_for(lambda: starts() == 2)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    def test_every_process_ends_by_itself(self, proc_info):
        killed = -signal.SIGKILL  # by the test
        assertExitCodes(proc_info, allowable_exit_codes=[0, killed])
