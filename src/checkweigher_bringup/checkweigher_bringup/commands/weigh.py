"""Weigh a bag offline: the stages in one loop, no ROS graph."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `weigh`."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='folder of a bag, or an .mcap file')
    parser.add_argument('--params', type=Path, metavar='FILE', help='ROS parameter file (YAML)')
    parser.add_argument(
        '--estimator', metavar='NAME', help='method that makes the mass; default iswd_eksi'
    )
    parser.add_argument(
        '--lane', metavar='NAME', help='namespace to weigh, if the bag holds several'
    )
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write one row an item to FILE')
    parser.add_argument('--overwrite', action='store_true', help='replace FILE if it exists')


def run(arguments: argparse.Namespace) -> int:
    """Weigh the bag and show each item."""
    from checkweigher_bringup.output import CsvOutput, Table, warn_unfinished
    from checkweigher_bringup.settings import line_parameters
    from checkweigher_recording.bags.reading import read_bag
    from checkweigher_validation.accuracy.offline import weigh

    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    output = CsvOutput(arguments.csv, arguments.overwrite)
    recording = read_bag(arguments.bag, arguments.lane, progress=True)
    warn_unfinished(recording)
    results = weigh(recording, parameters, progress=True)
    output.write(results)
    table = Table(recording.blocks[0].stamp)
    table.show_all(results)
    table.close()
    return 0
