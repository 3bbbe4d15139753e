# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Carry out the performance test that the recipe requires.

Examples
--------
checkweigher performance --who anna
"""

import argparse

from checkweigher_bringup.commands import NAMESPACE, REQUIRED

OPTIONS = (
    ('--who NAME', str, 'your name for the audit log', REQUIRED),
    ('--reason TEXT', str, 'reason for the test, for the audit log', ''),
    NAMESPACE,
    ('--timeout S', float, 'time in s after which the test is cancelled; default 600', 600.0),
)


def run(arguments: argparse.Namespace) -> int:
    """Guide the user through the test passes. Return 0 if the test has passed, otherwise 1."""
    from checkweigher_bringup.commissioning.performance_guide import make_test
    from checkweigher_bringup.settings import check_namespace, check_positive

    check_positive(arguments, 'timeout')
    lane = check_namespace(arguments.namespace)
    return 0 if make_test(lane, arguments.who, arguments.reason, arguments.timeout) else 1
