# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report on a batch, with the packers' rules, reference test, histogram and control chart.

Examples
--------
checkweigher batch bags/paper_60 --nominal 134.5 --html batch.html
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import ESTIMATOR, LANE, PARAMS, RECIPES
from checkweigher_bringup.errors import UserError

if TYPE_CHECKING:
    from checkweigher_production.recipes import Product
    from checkweigher_validation.batch.batch import Batch

_SOURCE = (
    'record of a batch (.jsonl), CSV file of weigh or replay, or bag; with --item also a folder of '
    'records'
)
_PLANS = (
    'sampling plan of the reference test: double sampling of 76/211/EEC (30, 50 or 80 items, and '
    'perhaps as many again), or single sampling of OIML R 87 (50, 80 or 125 items); default double'
)
OPTIONS = (
    ('source BATCH', Path, _SOURCE),
    (
        '--log,--audit LOG',
        Path,
        'audit log to compare the record with; default: audit.log in the folder of the machine',
        {'dest': 'log'},
    ),
    ('--users FILE', Path, 'file of the users whose keys the signatures must have'),
    ('--item N', int, 'only show the verdicts on item N in the record or in the folder'),
    ('--seed S', int, 'seed of the samples of the reference test; default 1', 1),
    ('--sampling', ('double', 'single'), _PLANS, 'double'),
    'product of a CSV file or bag',
    ('--nominal G', float, 'nominal weight of the contents in g'),
    ('--tare G', float, 'mass of the packaging in g; default 0', 0.0),
    RECIPES,
    ('--product NAME', str, 'product in the recipe file; a bag is weighed with its recipe'),
    'weighing of a bag',
    PARAMS,
    ESTIMATOR,
    LANE,
    'output',
    ('--html FILE', Path, 'write the report with tables and figures to FILE'),
    ('--json FILE', Path, 'write the report as JSON, with masses in kg, to FILE'),
    ('--overwrite', bool, 'replace existing files'),
)


def run(arguments: argparse.Namespace) -> int:
    """Print the statistics of the batch, and write the requested files.

    Returns 1 if the record cannot be trusted, or if a product fails the packers' rules or the
    reference test, otherwise 0. With `--item`, only the verdicts on the item are printed, no file
    is written, and 0 is returned.
    """
    from checkweigher_bringup.batch_report import batch_lines, fails, write_report
    from checkweigher_bringup.output import check_output_file
    from checkweigher_core.whole_file import is_stream
    from checkweigher_production.reference_method import SamplingPlan
    from checkweigher_validation.batch.figures import figures_of

    if arguments.item is not None:
        from checkweigher_bringup.batch_report import item_lines

        for line in item_lines(arguments.source, arguments.log, arguments.item):
            print(line)
        return 0
    html, json_file = arguments.html, arguments.json
    check_output_file(html, arguments.overwrite)
    check_output_file(json_file, arguments.overwrite)
    if html and json_file and html.resolve() == json_file.resolve() and not is_stream(html):
        raise UserError(f'--html and --json: both are {json_file}; give each its own file')
    if arguments.seed < 0:
        raise UserError(f'--seed {arguments.seed}: must not be negative')
    batch = _read(arguments)
    plan = SamplingPlan(arguments.sampling)
    parts = [figures_of(part, arguments.seed, plan) for part in batch.parts]
    print('\n'.join(batch_lines(batch, parts)))
    write_report(batch, parts, html, json_file)
    return int(fails(batch, parts))


def _read(arguments: argparse.Namespace) -> 'Batch':
    from dataclasses import replace

    from checkweigher_bringup.batch_report import signers_of
    from checkweigher_bringup.settings import refuse
    from checkweigher_validation.batch.batch import read_csv, read_recorded
    from checkweigher_validation.batch.signatures import foreign_keys

    if arguments.source.suffix == '.jsonl':
        why = 'not with a record of a batch, which contains its product and masses'
        refuse(arguments, why, 'nominal', 'recipes', 'product', 'params', 'estimator', 'lane')
        batch = read_recorded(arguments.source, arguments.log)
        if arguments.users is None:
            return batch
        faults = foreign_keys(batch.signatures, signers_of(arguments.users))
        return replace(batch, faults=(*batch.faults, *faults))
    refuse(arguments, 'only with a record of a batch', 'log', 'users', 'item')
    product = _product(arguments)
    if arguments.source.suffix == '.csv':
        return read_csv(arguments.source, product)
    return _weigh(arguments, product)


def _weigh(arguments: argparse.Namespace, product: 'Product') -> 'Batch':
    from checkweigher_bringup.output import read_with_warning
    from checkweigher_bringup.settings import line_parameters
    from checkweigher_validation.accuracy.results import weigh
    from checkweigher_validation.batch.batch import of_results

    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    if arguments.recipes is not None:
        parameters = parameters.with_values(product.stage_values())
    results = weigh(read_with_warning(arguments.source, arguments.lane), parameters, progress=True)
    name = arguments.source.resolve().name
    return of_results(name, name, results, product)


def _product(arguments: argparse.Namespace) -> 'Product':
    from checkweigher_bringup.settings import recipe_of, refuse
    from checkweigher_core.records import GRAMS
    from checkweigher_core.settings_files import settings_of
    from checkweigher_production.recipes import Product

    if (product := recipe_of(arguments)) is not None:
        refuse(arguments, 'not with --recipes, because the recipe has a nominal weight', 'nominal')
        return product
    if arguments.nominal is None:
        raise UserError('which product? Give --nominal, or --recipes and --product')
    values = {'nominal': arguments.nominal / GRAMS, 'tare': arguments.tare / GRAMS}
    return settings_of(Product, values, 'batch')
