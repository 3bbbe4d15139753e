# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Play a bag through the ROS graph and show each verdict.

Examples
--------
checkweigher replay bags/paper_60 --rate 0
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import WEIGHING

_PACE = 'speed relative to real time; 0: as fast as possible without loss of data; default 1'
_OTHERS = 'number of other subscribers of the samples, such as record, to wait for; default 0'
OPTIONS = (
    ('bag BAG', Path, 'folder of a bag, or an .mcap file'),
    *WEIGHING,
    ('--rate R', float, _PACE, 1.0),
    ('--namespace NAME', str, 'ROS namespace in which the graph runs', ''),
    ('--processes', bool, 'run each node in a process of its own'),
    ('--listeners N', int, _OTHERS, 0),
)


def run(arguments: argparse.Namespace) -> int:
    """Replay the bag, and print each verdict."""
    from checkweigher_bringup import output
    from checkweigher_bringup.replaying import replay
    from checkweigher_bringup.settings import check_namespace, line_parameters
    from checkweigher_core.whole_file import write_whole
    from checkweigher_driver.devices import DriverParameters
    from checkweigher_validation.accuracy.columns import items_as_csv
    from checkweigher_validation.accuracy.results import ResultJoiner

    # Invalid options raise ParameterError here, before the bag is read.
    DriverParameters(rate=arguments.rate, listeners=arguments.listeners)
    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    output.check_output_file(arguments.csv, arguments.overwrite)
    namespace = check_namespace(arguments.namespace)
    recording = output.read_with_warning(arguments.bag, arguments.lane)
    joiner = ResultJoiner(recording.edges, recording.references)
    table = output.ItemTable(recording.blocks[0].stamp)
    driver = {
        'source': 'bag',
        'rate': arguments.rate,
        'listeners': arguments.listeners,
        'bag.path': str(arguments.bag.absolute()),
        'bag.namespace': arguments.lane or '',
    }
    weighings = replay(driver, parameters, namespace, processes=arguments.processes)
    results = [table.show(joiner.join(each)) for each in weighings]
    results.sort(key=lambda result: result.estimate.item_id)
    if arguments.csv is not None:
        write_whole(arguments.csv, items_as_csv(results))
    table.close()
    return 0
