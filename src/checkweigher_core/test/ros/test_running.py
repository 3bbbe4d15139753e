# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Test of a process of nodes, which ends even if the destruction of a node hangs."""

import signal
import subprocess
import sys

from running import PATIENCE

HANGS = """
import threading
from checkweigher_core.ros import running
from rclpy.node import Node

class Hanging(Node):
    def destroy_node(self):
        print('hangs', flush=True)
        threading.Event().wait()

def make():
    node = Hanging('hanging')
    node.create_timer(0.1, lambda: print('ready', flush=True))
    return node

running.DESTRUCTION = 0.5
running.run(make)
"""


def test_a_process_ends_though_the_destruction_of_a_node_hangs():
    process = subprocess.Popen(
        [sys.executable, '-c', HANGS], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == 'ready\n'
    process.send_signal(signal.SIGTERM)
    output, errors = process.communicate(timeout=PATIENCE)
    assert output.endswith('hangs\n')
    assert process.returncode == 1
    assert 'in destroy_node' in errors
