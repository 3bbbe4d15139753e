# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Waiting of a command for its queue while a signal arrives."""

import subprocess
import sys

# A handler that is still at work when the time is over, as on a busy computer.
PROGRAM = """
import queue, signal, time, rclpy
from checkweigher_bringup.commissioning.sample_feed import SampleFeed
from checkweigher_bringup.commissioning.verification_guide import VerificationNode
from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.recorder import RecorderNode
rclpy.init()
signal.signal(signal.SIGALRM, lambda *_: time.sleep(0.2))
for waiting in (
    ResultListener('listener').weighings,
    RecorderNode((), None).messages,
    VerificationNode().verdicts,
    SampleFeed('line')._messages,
):
    signal.setitimer(signal.ITIMER_REAL, 0.02)
    try:
        waiting.get(timeout=0.05)
    except queue.Empty:
        print('ended')
"""


def test_a_wait_ends_though_a_signal_comes_when_its_time_is_over():
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM], capture_output=True, text=True, timeout=60
    )
    assert done.stdout == 4 * 'ended\n', done.stderr
