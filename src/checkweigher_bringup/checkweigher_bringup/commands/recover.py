"""Make a bag of what a killed recorder left."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `recover`."""
    parser.add_argument('file', type=Path, metavar='FILE', help='.mcap file without an end')
    parser.add_argument('--output', type=Path, required=True, metavar='DIR', help='bag to write')


def run(arguments: argparse.Namespace) -> int:
    """Write the bag; the file stays as it is."""
    from checkweigher_driver.bag_recovery import recover_bag

    count = recover_bag(arguments.file, arguments.output)
    print(f'{arguments.output}: {count} messages')
    return 0
