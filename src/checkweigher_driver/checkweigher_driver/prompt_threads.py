# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Latency of the threads that a machine waits for."""

import sys

_SWITCH_INTERVAL = 0.0005  # s


def shorten_switch_interval() -> None:
    """Have the threads of this process take turns often, though each switch costs all of them.

    For threads that tell when a photo-eye switched, or that switch the rejector: what they wait
    for the interpreter is added to their uncertainty.
    """
    sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_INTERVAL))
