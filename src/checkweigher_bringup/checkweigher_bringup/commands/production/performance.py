# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Make the performance test of the product on the line."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `performance`."""
    add = parser.add_argument
    add('--who', required=True, metavar='NAME', help='who makes it; goes into the audit log')
    add('--reason', default='', metavar='TEXT', help='why it is made now')
    add('--namespace', default='', metavar='NAME', help='of the lane')
    add('--timeout', type=float, default=600.0, metavar='S',
        help='break it off if it has not ended by then (default: 600)')  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Guide through the passes; 0 if the test has passed, else 1."""
    from checkweigher_bringup.commissioning.performance_guide import make_test
    from checkweigher_bringup.settings import check_namespace, check_positive

    check_positive(arguments, 'timeout')
    lane = check_namespace(arguments.namespace)
    passed = make_test(lane, arguments.who, arguments.reason, arguments.timeout)
    return 0 if passed else 1
