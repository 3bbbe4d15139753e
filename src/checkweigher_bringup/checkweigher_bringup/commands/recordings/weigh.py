# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weigh a bag offline: the stages in one loop, no ROS graph."""

import argparse
from collections.abc import Iterable, Iterator
from contextlib import closing
from functools import partial
from itertools import chain
from pathlib import Path
import shutil
import sys
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, TextIO

from checkweigher_bringup.commands import add_bags, add_scheduling, add_weighing
from checkweigher_bringup.errors import UserError
from checkweigher_core.printable import one_line

if TYPE_CHECKING:
    from checkweigher_core.recording import Recording
    from checkweigher_dsp.pipeline.line import LineParameters
    from checkweigher_validation.accuracy.results import ItemResult
    from checkweigher_validation.archive.weighing import Weighed

EXAMPLES = (
    'weigh shift*/ --output results                     # a Parquet file per bag, and a summary',
    'weigh s3://plant/2026 --output results --scheduler tcp://10.0.0.5:8786',
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `weigh`."""
    add_bags(parser, 'bags')
    add_weighing(parser)
    many = parser.add_argument_group('any number of bags')
    many.add_argument('--output', type=Path, metavar='DIR',
                      help='write a Parquet file per bag, and summary.csv, to DIR; what is there '
                      'of the same bags, parameters and program is kept')  # fmt: skip
    add_scheduling(many)


def run(arguments: argparse.Namespace) -> int:
    """Weigh one bag and show each item, or any number of bags and write their results."""
    from checkweigher_bringup.settings import line_parameters

    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    if arguments.output is not None:
        return _weigh_all(arguments, parameters)
    from checkweigher_recording.archive.finding import find_bags

    if arguments.jobs is not None or arguments.scheduler != 'local':
        raise UserError('--jobs, --scheduler: of --output DIR; one bag is one job')
    bag, *others = find_bags(arguments.bags)
    if others:
        raise UserError('several bags: add --output DIR, for a file with the results of each')
    return _weigh_one(bag, arguments, parameters)


def _weigh_one(bag: str, arguments: argparse.Namespace, parameters: 'LineParameters') -> int:
    """Weigh a bag and show each item."""
    from checkweigher_bringup.output import check_output_file
    from checkweigher_core.whole_file import write_whole
    from checkweigher_recording.archive.copying import local_bag
    from checkweigher_recording.bags.reading import over_stretches

    check_output_file(arguments.csv, arguments.overwrite)
    # On the disk until the end of the bag has been read: it may show that nothing is to be used.
    with _spool() as table, _spool() as rows, local_bag(bag) as path:
        work = partial(_weigh, parameters=parameters, table=table, rows=rows)
        over_stretches(work, path, arguments.lane, progress=True)
        table.seek(0)
        rows.seek(0)
        if arguments.csv is not None:
            write_whole(arguments.csv, rows)
        shutil.copyfileobj(table, sys.stdout)
    return 0


def _weigh_all(arguments: argparse.Namespace, parameters: 'LineParameters') -> int:
    """Weigh any number of bags and write the results of each; 1 if a bag was passed over."""
    from checkweigher_bringup.settings import on_scheduler_of, places_of
    from checkweigher_recording.archive.finding import find_bags, result_names
    from checkweigher_validation.archive.program import program
    from checkweigher_validation.archive.results_folder import ResultsFolder
    from checkweigher_validation.archive.weighing import WeighJob, weigh_bags

    if arguments.csv is not None:
        raise UserError('--csv: of one bag; --output DIR has the results of all')
    names = result_names(find_bags(arguments.bags))
    bags = places_of(arguments, names)
    jobs = {
        name: WeighJob(bag, parameters, arguments.lane, program())
        for name, bag in zip(names.values(), bags, strict=True)
    }
    with on_scheduler_of(arguments) as n_jobs:
        results = ResultsFolder(arguments.output, jobs)
        with closing(weigh_bags(results.jobs, n_jobs)) as done:
            for found in done:
                _tell(results.take(found), results.progress, arguments.scheduler)
    said = results.close()
    print(f'{arguments.output}: {said}')
    return int(results.broken > 0)


def _tell(weighed: 'Weighed', progress: str, scheduler: str) -> None:
    """Print a line on a bag, and on stderr what is wrong with it."""
    lines = weighed.summary.notes if weighed.summary else ()
    said = [f'{weighed.bag}: {line}' for line in lines]
    if weighed.problem:
        known = scheduler != 'local' and weighed.host
        where = f'on worker {weighed.host}: ' if known else ''
        said = [f'{where}{weighed.problem}; passed over']
    for line in said:
        print(one_line(line), file=sys.stderr, flush=True)
    items = f'{weighed.summary.items} items' if weighed.summary else 'passed over'
    print(f'{progress}: {one_line(weighed.bag)}: {items}', flush=True)


def _spool() -> TextIO:
    return TemporaryFile('w+', encoding='utf-8', errors='surrogatepass', newline='')


def _weigh(
    stretches: 'Iterable[Recording]', parameters: 'LineParameters', table: TextIO, rows: TextIO
) -> None:
    """Write the table of a bag that comes in stretches, and the rows of its CSV."""
    from checkweigher_bringup.output import Table, print_warning
    from checkweigher_validation.accuracy.columns import write_csv
    from checkweigher_validation.accuracy.results import weigh_stretches

    for file in (table, rows):
        file.seek(0)
        file.truncate()
    stretches = iter(stretches)
    first = next(stretches)
    shown = Table(first.blocks[0].stamp, table)

    def told() -> 'Iterator[Recording]':
        for stretch in chain([first], stretches):
            print_warning(stretch)
            yield stretch

    def seen() -> 'Iterator[ItemResult]':
        for result in weigh_stretches(told(), parameters):
            shown.show(result)
            yield result

    write_csv(rows, seen())
    shown.close()
