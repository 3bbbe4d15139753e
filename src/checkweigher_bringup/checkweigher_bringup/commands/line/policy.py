# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Write the security policy of a line for SROS2: what each node may publish, take and call."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `policy`."""
    parser.add_argument('--namespace', nargs='*', default=[''], metavar='NAME',
                        help='the lanes; default one without a namespace')  # fmt: skip
    parser.add_argument('--output', type=Path, metavar='FILE', help='file; default standard output')
    parser.add_argument('--overwrite', action='store_true', help='replace a file that exists')


def run(arguments: argparse.Namespace) -> int:
    """Write the policy."""
    from checkweigher_bringup.output import check_output_file
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_core.ros.access.policy import policy
    from checkweigher_core.whole_file import write_whole

    check_output_file(arguments.output, arguments.overwrite)
    text = policy([check_namespace(each) for each in arguments.namespace])
    if arguments.output is None:
        print(text, end='')
    else:
        write_whole(arguments.output, text)
    return 0
