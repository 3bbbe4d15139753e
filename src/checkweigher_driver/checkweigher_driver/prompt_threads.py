# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Latency of the threads of photo-eyes and outputs."""

import sys

_SWITCH_INTERVAL = 0.0005  # s


def shorten_switch_interval() -> None:
    """Let the threads of this process take turns more often, at the cost of more switches.

    This is for threads that time photo-eyes or switch the rejector: the time for which they wait
    for the interpreter adds to their uncertainty.
    """
    sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_INTERVAL))
