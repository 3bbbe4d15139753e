# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weigh a bag offline: the stages in one loop, no ROS graph."""

import argparse

from checkweigher_bringup.commands import add_weighing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `weigh`."""
    add_weighing(parser)


def run(arguments: argparse.Namespace) -> int:
    """Weigh the bag and show each item."""
    from checkweigher_bringup.output import Table, check_output_file, warn_unfinished, write_results
    from checkweigher_bringup.settings import line_parameters
    from checkweigher_recording.bags.reading import read_bag
    from checkweigher_validation.accuracy.results import weigh

    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    check_output_file(arguments.csv, arguments.overwrite)
    recording = read_bag(arguments.bag, arguments.lane, progress=True)
    warn_unfinished(recording)
    results = weigh(recording, parameters, progress=True)
    write_results(arguments.csv, results)
    table = Table(recording.blocks[0].stamp)
    table.show(*results)
    table.close()
    return 0
