"""Play a bag through the ROS graph and show each verdict."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `replay`."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='folder of a bag, or an .mcap file')
    parser.add_argument(
        '--rate', type=float, default=1.0, metavar='R',
        help='seconds of signal in a second; 0 as fast as nothing is lost (default 1)',
    )  # fmt: skip
    parser.add_argument('--params', type=Path, metavar='FILE', help='ROS parameter file (YAML)')
    parser.add_argument(
        '--estimator', metavar='NAME', help='method that makes the mass; default iswd_eksi'
    )
    parser.add_argument(
        '--lane', metavar='NAME', help='namespace to replay, if the bag holds several'
    )
    parser.add_argument(
        '--namespace', default='', metavar='NAME', help='ROS namespace to run the graph in'
    )
    parser.add_argument(
        '--processes', action='store_true', help='run each node in a process of its own'
    )
    parser.add_argument(
        '--listeners', type=int, default=0, metavar='N',
        help='begin when N others take the samples, such as record, started before or after',
    )  # fmt: skip
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write one row an item to FILE')
    parser.add_argument('--overwrite', action='store_true', help='replace FILE if it exists')


def run(arguments: argparse.Namespace) -> int:
    """Replay the bag; 1 if an item got no verdict."""
    from checkweigher_bringup.output import CsvOutput, Table, warn_unfinished
    from checkweigher_bringup.replaying import Replay, replay
    from checkweigher_bringup.settings import check_namespace, line_parameters
    from checkweigher_driver.devices import DriverParameters
    from checkweigher_recording.bags.reading import read_bag
    from checkweigher_validation.accuracy.results import ItemResult, ResultJoiner

    # Raises ParameterError before anything is done.
    DriverParameters(rate=arguments.rate, listeners=arguments.listeners)
    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    output = CsvOutput(arguments.csv, arguments.overwrite)
    namespace = check_namespace(arguments.namespace)
    recording = read_bag(arguments.bag, arguments.lane, progress=True)
    warn_unfinished(recording)
    joiner = ResultJoiner(recording.edges, recording.references)
    table = Table(recording.blocks[0].stamp)
    results: list[ItemResult] = []
    plan = Replay(
        arguments.bag, arguments.lane or '', arguments.rate, parameters, namespace,
        arguments.processes, arguments.listeners,
    )  # fmt: skip
    for weighing in replay(plan):
        result = joiner.join(weighing.estimate, weighing.verdict)
        table.show(result)
        results.append(result)
    results.sort(key=lambda result: result.estimate.item_id)
    output.write(results)
    table.close()
    return 0
