# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weigh bags offline, with the same stages as the graph.

Examples
--------
checkweigher weigh bags/paper_60 --csv masses.csv
checkweigher weigh shift*/ --output results  # a Parquet file for each bag, and a summary
checkweigher weigh s3://plant/2026 --output results --scheduler tcp://10.0.0.5:8786
"""

import argparse
from collections import deque
from collections.abc import Iterable
from contextlib import closing
from functools import partial
from itertools import chain
from pathlib import Path
import shutil
import sys
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, TextIO

from checkweigher_bringup.commands import SCHEDULING, WEIGHING, bags
from checkweigher_bringup.errors import UserError, warn
from checkweigher_core.printable import one_line

if TYPE_CHECKING:
    from checkweigher_core.recording import Recording
    from checkweigher_dsp.pipeline.line import LineParameters
    from checkweigher_validation.archive.weighing import Weighed

_FOLDER = (
    'write a Parquet file for each bag, and summary.csv, to DIR; a bag is not weighed again if DIR '
    'contains its file from the same parameters and program'
)
OPTIONS = (
    bags('bags'),
    *WEIGHING,
    'any number of bags',
    ('--output DIR', Path, _FOLDER),
    *SCHEDULING,
)


def run(arguments: argparse.Namespace) -> int:
    """Weigh one bag and print each item, or weigh any number of bags and write their results."""
    from checkweigher_bringup.settings import line_parameters

    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    if arguments.output is not None:
        return _weigh_all(arguments, parameters)
    from checkweigher_recording.archive.finding import find_bags

    if arguments.jobs is not None or arguments.scheduler != 'local':
        raise UserError('--jobs, --scheduler: only with --output DIR, because one bag is one job')
    bag, *others = find_bags(arguments.bags)
    if others:
        raise UserError('several bags: add --output DIR, in which each bag gets a file of results')
    return _weigh_one(bag, arguments, parameters)


def _weigh_one(bag: str, arguments: argparse.Namespace, parameters: 'LineParameters') -> int:
    from checkweigher_bringup.output import check_output_file
    from checkweigher_core.whole_file import write_whole
    from checkweigher_recording.archive.copying import local_bag
    from checkweigher_recording.bags.reading import over_stretches

    check_output_file(arguments.csv, arguments.overwrite)
    with local_bag(bag) as path:
        work = partial(_weigh, parameters=parameters, with_rows=arguments.csv is not None)
        table, rows = over_stretches(work, path, arguments.lane, progress=True)
    with table, rows:
        if arguments.csv is not None:
            write_whole(arguments.csv, rows)
        shutil.copyfileobj(table, sys.stdout)
    return 0


def _weigh_all(arguments: argparse.Namespace, parameters: 'LineParameters') -> int:
    """Weigh bags and write the results of each. Return 1 if a bag was skipped, otherwise 0."""
    from checkweigher_bringup.settings import on_scheduler_of, places_of, refuse
    from checkweigher_recording.archive.finding import find_bags, result_names
    from checkweigher_validation.archive.program import program
    from checkweigher_validation.archive.results_folder import ResultsFolder
    from checkweigher_validation.archive.weighing import WeighJob, weigh_bags

    refuse(arguments, 'not with --output, where each bag gets a file of results', 'csv')
    names = result_names(find_bags(arguments.bags))
    jobs = {
        name: WeighJob(bag, parameters, arguments.lane, program())
        for name, bag in zip(names.values(), places_of(arguments, names), strict=True)
    }
    with on_scheduler_of(arguments) as n_jobs:
        results = ResultsFolder(arguments.output, jobs)
        with closing(weigh_bags(results.jobs, n_jobs)) as done:
            for found in done:
                _report(results.take(found), results.progress, arguments.scheduler)
    print(f'{arguments.output}: {results.close()}')
    return int(results.broken > 0)


def _report(weighed: 'Weighed', progress: str, scheduler: str) -> None:
    for note in weighed.summary.notes if weighed.summary else ():
        warn(f'{weighed.bag}: {note}')
    if weighed.problem:
        where = f'on worker {weighed.host}: ' if weighed.host and scheduler != 'local' else ''
        warn(f'{where}{weighed.problem}; skipped')
    items = f'{weighed.summary.items} items' if weighed.summary else 'skipped'
    print(f'{progress}: {one_line(weighed.bag)}: {items}', flush=True)


def _weigh(
    stretches: 'Iterable[Recording]', parameters: 'LineParameters', with_rows: bool
) -> tuple[TextIO, TextIO]:
    """Weigh the parts of a bag, and return a file with the table and a CSV file with the items.

    If `with_rows` is False, the CSV file is empty. The results are written to temporary files,
    because an error at the end of the bag makes all results invalid.
    """
    from checkweigher_bringup.output import ItemTable, with_warning
    from checkweigher_validation.accuracy.columns import items_as_csv
    from checkweigher_validation.accuracy.results import weigh_stretches

    stretches = iter(stretches)
    first = next(stretches)
    table, rows = _spool(), _spool()
    shown = ItemTable(first.blocks[0].stamp, table)
    recordings = map(with_warning, chain([first], stretches))
    items = map(shown.show, weigh_stretches(recordings, parameters))
    if with_rows:
        rows.writelines(items_as_csv(items))
    deque(items, maxlen=0)  # Add the items to the table, unless `rows.writelines` has done so.
    shown.close()
    table.seek(0)
    rows.seek(0)
    return table, rows


def _spool() -> TextIO:
    return TemporaryFile('w+', encoding='utf-8', errors='surrogatepass', newline='')
