# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Make a whole bag of a recording that broke off."""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import add_new_bag


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `recover`."""
    parser.add_argument('bag', type=Path, metavar='BAG',
                        help='folder without metadata.yaml, or cut .mcap file')  # fmt: skip
    add_new_bag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the bag; what is there stays as it is."""
    from checkweigher_recording.bags.recovery import recover_bag

    count = recover_bag(arguments.bag, arguments.output)
    print(f'{arguments.output}: {count} messages')
    return 0
