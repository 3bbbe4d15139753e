# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS layer that all nodes share: ports, stage nodes, outputs, diagnostics."""

from contextlib import suppress
import os
from pathlib import Path
import tempfile

from checkweigher_core.ros.graph.discovery import set_profiles


def _set_log_folder() -> None:
    """Make rcl write its logs to a temporary folder if the user has no writable home folder.

    A folder that the user has set by ROS_LOG_DIR or ROS_HOME is used instead.
    """
    home = os.environ.get('HOME', '')
    given = os.environ.get('ROS_LOG_DIR') or os.environ.get('ROS_HOME')
    if not given and not (home and os.access(home, os.W_OK)):
        folder = Path(tempfile.gettempdir(), f'checkweigher-{os.geteuid()}')
        with suppress(OSError):
            folder.mkdir(mode=0o700, exist_ok=True)
        os.environ['ROS_LOG_DIR'] = str(folder / 'log')


# Set the environment now, because rclpy reads the variables when it creates a context. A node that
# is connected by DDS can stop a line and change its limits. Nodes on other computers can therefore
# connect only if the user sets ROS_AUTOMATIC_DISCOVERY_RANGE or ROS_STATIC_PEERS.
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
_set_log_folder()
set_profiles()
