# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the masses and verdicts of a running line as they arrive.

Examples
--------
checkweigher echo --namespace lane1
"""

import argparse
from contextlib import closing, suppress
import math
import queue
import time

from checkweigher_bringup.commands import DURATION, NAMESPACE

_PATIENCE = 5.0  # time in s without a verdict after which a new reason for the silence is shown
_POLL_PERIOD = 0.2  # s

OPTIONS = (NAMESPACE, ('--count N', int, 'end after N verdicts'), DURATION)


def run(arguments: argparse.Namespace) -> int:
    """Print one line for each verdict until a signal arrives, or an option ends the command."""
    from checkweigher_bringup.errors import warn
    from checkweigher_bringup.listening import EchoNode
    from checkweigher_bringup.output import ItemTable
    from checkweigher_bringup.settings import check_namespace, check_positive
    from checkweigher_bringup.spinning import spinning
    from checkweigher_core.ros.graph.policy import OBSERVER

    check_positive(arguments, 'count', 'duration')
    count, end = arguments.count or math.inf, time.monotonic() + (arguments.duration or math.inf)
    with (
        spinning(check_namespace(arguments.namespace), OBSERVER) as spinner,
        closing(ItemTable()) as table,
    ):
        node = EchoNode()
        spinner.add(node)
        warn(shown := f'waiting for verdicts on {node.place()}; press Ctrl-C to end')
        with suppress(KeyboardInterrupt):
            while table.count < count and time.monotonic() < end:
                try:
                    table.show(node.result(node.weighings.get(timeout=_POLL_PERIOD)))
                except queue.Empty:
                    if time.monotonic() - node.heard > _PATIENCE:
                        node.heard = time.monotonic()
                        if (silence := node.silence()) != shown:
                            warn(shown := silence)
    return 0
