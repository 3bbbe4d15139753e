# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report on a batch: what passed, the packers' rules of 76/211/EEC and the reference test."""

import argparse
from collections.abc import Iterator
import math
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import add_parameter_file, add_recipe
from checkweigher_bringup.errors import UserError

if TYPE_CHECKING:
    from checkweigher_production.recipes import Product
    from checkweigher_validation.batch.batch import Batch
    from checkweigher_validation.batch.figures import PartFigures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `batch`."""
    add = parser.add_argument
    add(
        'source',
        type=Path,
        metavar='BATCH',
        help='record of the line (.jsonl, of product.batch_folder), CSV of weigh, or a bag',
    )
    add('--audit', type=Path, metavar='LOG',
        help='audit log with the changes; default the one that the record names')  # fmt: skip
    add('--seed', type=int, default=1, metavar='S',
        help='draws the samples of the reference test; default 1')  # fmt: skip
    add('--sampling', choices=('double', 'single'), default='double',
        help='plan of the reference test: double of 76/211/EEC (30, 50 or 80, and as many again) '
             'or single of OIML R 87 (50, 80 or 125); default double')  # fmt: skip
    of_product = parser.add_argument_group('the product, which a record has itself').add_argument
    of_product('--nominal', type=float, metavar='G', help='nominal weight of the contents, g')
    of_product('--tare', type=float, default=0.0, metavar='G', help='of the packaging, g')
    add_recipe(of_product, 'a bag is weighed by this recipe')
    how = parser.add_argument_group('how a bag is weighed')
    add_parameter_file(how)
    how.add_argument('--estimator', metavar='NAME', help='estimator of the mass')
    how.add_argument('--lane', metavar='NAME', help='namespace to take, if the bag has several')
    add = parser.add_argument_group('what is written').add_argument
    add('--html', type=Path, metavar='FILE', help='report with tables and figures, one file')
    add('--json', type=Path, metavar='FILE', help='the same for a program, masses in kg')
    add('--overwrite', action='store_true', help='replace files that exist')


def run(arguments: argparse.Namespace) -> int:
    """Show the figures and write the files that are asked for; 1 if the record is another one."""
    from checkweigher_bringup.batch_report import write_report
    from checkweigher_bringup.output import check_output_file
    from checkweigher_core.whole_file import is_stream
    from checkweigher_production.reference_method import SamplingPlan
    from checkweigher_validation.batch.batch import InLog
    from checkweigher_validation.batch.figures import figures_of

    for path in (arguments.html, arguments.json):
        check_output_file(path, arguments.overwrite)
    html, json_file = (path and path.resolve() for path in (arguments.html, arguments.json))
    if html is not None and html == json_file and not is_stream(html):
        raise UserError(f'--html and --json: both are {arguments.json}; give each its own file')
    if arguments.seed < 0:
        raise UserError(f'--seed {arguments.seed}: must not be below 0')
    batch = _read(arguments)
    plan = SamplingPlan(arguments.sampling)
    parts = [figures_of(part, arguments.seed, plan) for part in batch.parts]
    for line in _lines(batch, parts):
        print(line)
    write_report(batch, parts, arguments.html, arguments.json)
    return 1 if batch.in_log is InLog.DIFFERS else 0


def _read(arguments: argparse.Namespace) -> 'Batch':
    from checkweigher_bringup.batch_report import read_recorded
    from checkweigher_validation.batch.batch import read_csv

    if arguments.source.suffix == '.jsonl':
        for name in ('nominal', 'recipes', 'product', 'params', 'estimator', 'lane'):
            if getattr(arguments, name) is not None:
                raise UserError(f'--{name}: the record of a batch has its product and its masses')
        return read_recorded(arguments.source, arguments.audit)
    if arguments.audit is not None:
        raise UserError('--audit: only the record of a batch says from when to when it lasted')
    product = _product(arguments)
    if arguments.source.suffix == '.csv':
        return read_csv(arguments.source, product)
    return _weigh(arguments, product)


def _weigh(arguments: argparse.Namespace, product: 'Product') -> 'Batch':
    from checkweigher_bringup.output import print_warning
    from checkweigher_bringup.settings import line_parameters
    from checkweigher_recording.bags.reading import read_bag
    from checkweigher_validation.accuracy.results import weigh
    from checkweigher_validation.batch.batch import of_results

    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    if arguments.recipes is not None:
        parameters = parameters.with_values(product.stage_values())
    recording = read_bag(arguments.source, arguments.lane, progress=True)
    print_warning(recording)
    results = weigh(recording, parameters, progress=True)
    return of_results(arguments.source.name, str(arguments.source), results, product)


def _product(arguments: argparse.Namespace) -> 'Product':
    from checkweigher_bringup.settings import recipe_of
    from checkweigher_core.records import GRAMS
    from checkweigher_production.recipes import make_product

    product = recipe_of(arguments)
    if product is not None and arguments.nominal is not None:
        raise UserError('--nominal: the recipe has the nominal weight; give one of both')
    if product is not None:
        return product
    if arguments.nominal is None:
        raise UserError('which product? Give --nominal, or --recipes and --product')
    values = {'nominal': arguments.nominal / GRAMS, 'tare': arguments.tare / GRAMS}
    return make_product('batch', values)


def _lines(batch: 'Batch', parts: 'list[PartFigures]') -> Iterator[str]:
    """Yield how the record compares with the audit log, and the figures of each product."""
    from checkweigher_core.printable import one_line
    from checkweigher_core.records import GRAMS
    from checkweigher_validation.batch.batch import InLog

    title = f'batch {one_line(batch.name)}'
    if batch.in_log is InLog.AGREES:
        yield f'{title}: the SHA-256 of its record agrees with the audit log'
    elif batch.in_log is InLog.DIFFERS:
        yield (
            f'{title}: the SHA-256 of its record DIFFERS from that in the audit log: it '
            'is not as it was when the batch ended'
        )
    elif batch.in_log is InLog.ABSENT:
        why = '' if batch.end else ': the batch has not ended yet'
        yield f'{title}: the SHA-256 of its record is not in the audit log{why}'
    for part in parts:
        name, nominal = one_line(part.product.name or 'no product'), GRAMS * part.product.nominal
        counts = ', '.join(f'{count} {each}' for each, count in part.decisions.items() if count)
        yield f'{title}, {name}: {part.items} items: {counts or "none"}'
        for why, count in part.reasons.items():
            yield f'  {count:>6} {one_line(why)}'
        if math.isnan(part.mean):
            continue
        spread = ''
        if not math.isnan(part.std_dev):  # of one item there is none
            spread = f'standard deviation {GRAMS * part.std_dev:.3f} g, '
        # Adding zero makes minus zero a plain one.
        giveaway = round(GRAMS * part.giveaway, 3) + 0.0
        yield (
            f'  mean {GRAMS * part.mean:.3f} g of {nominal:g} g, {spread}giveaway {giveaway:+.3f} g'
        )
        yield from _judgement(part)


def _judgement(part: 'PartFigures') -> Iterator[str]:
    from checkweigher_core.records import GRAMS

    rules, test = part.judgement, part.reference
    if rules is None or test is None:
        yield '  76/211/EEC has no limits for this nominal weight'
        return
    yield (
        f'  rules: mean {_word(rules.mean_passed)}; below TU1 {rules.below_tu1} '
        f'({100 * rules.share_below_tu1:.2f} %) {_word(rules.tu1_passed)}; below TU2 '
        f'{rules.below_tu2} {_word(rules.tu2_passed)}'
    )
    last = test.samples[-1]
    below_tu2 = f', {test.below_tu2} below TU2, none allowed' if test.tu2_decides else ''
    yield (
        f'  reference test, {test.plan.value} sampling: {last.defective} of {last.count} below '
        f'TU1, at most {last.accept}{below_tu2}: {_word(test.contents_passed)}; mean of '
        f'{test.mean_count} {GRAMS * test.mean:.3f} g, at least {GRAMS * test.mean_limit:.3f} g: '
        f'{_word(test.mean_passed)}'
    )


def _word(passed: bool) -> str:
    return 'met' if passed else 'NOT met'
