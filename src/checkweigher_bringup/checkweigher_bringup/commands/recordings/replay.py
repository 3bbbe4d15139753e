# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Play a bag through the ROS graph and show each verdict."""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import add_weighing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `replay`."""
    add = parser.add_argument
    add('bag', type=Path, metavar='BAG', help='folder of a bag, or an .mcap file')
    add_weighing(parser)
    add('--rate', type=float, default=1.0, metavar='R',
        help='seconds of signal in a second; 0 as fast as nothing is lost (default 1)')  # fmt: skip
    add('--namespace', default='', metavar='NAME', help='ROS namespace to run the graph in')
    add('--processes', action='store_true', help='run each node in a process of its own')
    add('--listeners', type=int, default=0, metavar='N',
        help='begin when N others take the samples, such as record, started before or after',
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Replay the bag; 1 if an item got no verdict."""
    from checkweigher_bringup.output import Table, check_output_file, print_warning, write_results
    from checkweigher_bringup.replaying import replay
    from checkweigher_bringup.settings import check_namespace, line_parameters
    from checkweigher_driver.devices import DriverParameters
    from checkweigher_recording.bags.reading import read_bag
    from checkweigher_validation.accuracy.results import ItemResult, ResultJoiner

    # Raises ParameterError before anything is done.
    DriverParameters(rate=arguments.rate, listeners=arguments.listeners)
    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    check_output_file(arguments.csv, arguments.overwrite)
    namespace = check_namespace(arguments.namespace)
    recording = read_bag(arguments.bag, arguments.lane, progress=True)
    print_warning(recording)
    joiner = ResultJoiner(recording.edges, recording.references)
    table = Table(recording.blocks[0].stamp)
    results: list[ItemResult] = []
    weighings = replay(
        arguments.bag, arguments.lane or '', arguments.rate, parameters, namespace=namespace,
        processes=arguments.processes, listeners=arguments.listeners)  # fmt: skip
    for weighing in weighings:
        result = joiner.join(weighing.estimate, weighing.verdict)
        table.show(result)
        results.append(result)
    results.sort(key=lambda result: result.estimate.item_id)
    write_results(arguments.csv, results)
    table.close()
    return 0
