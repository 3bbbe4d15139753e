"""Accuracy of the estimators on passes of known mass."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import add_parameter_file, add_tuning

if TYPE_CHECKING:
    from checkweigher_validation.accuracy.classes import AccuracyClass


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `evaluate`."""
    what = parser.add_argument_group('what is weighed')
    what.add_argument('bags', type=Path, nargs='*', metavar='BAG', help='bags with reference_mass')
    what.add_argument(
        '--protocol', choices=('paper',),
        help='instead of bags simulate 5 speeds x 5 masses, tune on the first half of the passes '
        'and test on the second',
    )  # fmt: skip
    what.add_argument(
        '--profile', default='paper', metavar='NAME',
        help='simulated machine: paper (default), roller, soft, floor or quiet',
    )  # fmt: skip
    what.add_argument(
        '--passes', type=int, default=120, metavar='N',
        help='of each mass at each speed in the protocol; default 120',
    )  # fmt: skip
    what.add_argument('--seed', type=int, default=1, metavar='S', help='of the protocol')
    how = parser.add_argument_group('how it is weighed')
    how.add_argument(
        '--train', type=Path, nargs='+', action='extend', metavar='BAG',
        help='tune on these bags first; BAG then are the test',
    )  # fmt: skip
    add_parameter_file(how)
    add_tuning(how)
    judged = parser.add_argument_group('how it is judged')
    judged.add_argument(
        '--class', dest='accuracy_class', default='XIII', metavar='CLASS',
        help='of GB/T 27739 and OIML R 51: XI, XII, XIII (default) or XIV',
    )  # fmt: skip
    judged.add_argument('--factor', type=float, default=1.0, metavar='X', help='class factor x')
    judged.add_argument(
        '--interval', type=float, default=0.1, metavar='G',
        help='verification scale interval e, g; default 0.1',
    )  # fmt: skip
    judged.add_argument(
        '--in-service', action='store_true', help='limits in service, not of initial verification'
    )
    judged.add_argument(
        '--nominal', type=float, metavar='G',
        help='nominal quantity, g: also show the limits of EU directive 76/211/EEC',
    )  # fmt: skip
    written = parser.add_argument_group('what is written')
    for name, text in (
        ('html', 'report with tables and figures, one file'),
        ('csv', 'one row for each estimator, speed, mass and part'),
        ('json', 'the same with every error'),
        ('tuned', 'parameter file with what was tuned'),
    ):
        written.add_argument(f'--{name}', type=Path, metavar='FILE', help=text)
    written.add_argument('--overwrite', action='store_true', help='replace files that exist')


def run(arguments: argparse.Namespace) -> int:
    """Weigh, show the table and write the files that are asked for."""
    from checkweigher_bringup.evaluation import evaluate_bags, evaluate_simulation
    from checkweigher_recording.whole_file import write_whole
    from checkweigher_validation.accuracy.tables import csv_text, json_text, text_table
    from checkweigher_validation.tuning.parameter_file import parameter_file

    _check(arguments)
    accuracy_class, nominal = _accuracy_class(arguments), _nominal(arguments)
    evaluate = evaluate_simulation if arguments.protocol else evaluate_bags
    evaluation, tuned = evaluate(arguments)
    print(text_table(evaluation, accuracy_class))
    if arguments.html:
        from checkweigher_validation.report.page import render

        write_whole(arguments.html, render(evaluation, accuracy_class, nominal))
    if arguments.csv:
        write_whole(arguments.csv, csv_text(evaluation, accuracy_class))
    if arguments.json:
        write_whole(arguments.json, json_text(evaluation))
    if arguments.tuned:
        source = [f'{name}: {value}' for name, value in evaluation.provenance]
        write_whole(arguments.tuned, parameter_file(tuned, source))
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """Refuse options that cannot be used, before the work and not after it."""
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.output import check_output_file
    from checkweigher_bringup.settings import check_positive

    if bool(arguments.bags) == bool(arguments.protocol):
        raise UserError('name bags, or --protocol paper to simulate')
    check_positive(arguments, 'budget', 'jobs', 'nominal')
    if arguments.tuned and not (arguments.train or arguments.protocol):
        raise UserError('--tuned: nothing would be tuned; add --train BAG')
    given = (arguments.html, arguments.csv, arguments.json, arguments.tuned)
    outputs = [path for path in given if path is not None]
    for path in outputs:
        check_output_file(path, arguments.overwrite)
        if outputs.count(path) > 1:
            raise UserError(f'{path}: cannot be two of the outputs at once')


def _accuracy_class(arguments: argparse.Namespace) -> 'AccuracyClass':
    from checkweigher_bringup.errors import UserError
    from checkweigher_validation.accuracy.classes import AccuracyClass

    try:
        return AccuracyClass(
            arguments.accuracy_class, arguments.factor, arguments.interval / 1000,
            arguments.in_service,
        )  # fmt: skip
    except ValueError as error:
        raise UserError(f'--class: {error}') from None


def _nominal(arguments: argparse.Namespace) -> float | None:
    """Return the nominal quantity in kg if there are limits of 76/211/EEC for it."""
    from checkweigher_bringup.errors import UserError
    from checkweigher_dsp.production.prepackages import limits

    if arguments.nominal is None:
        return None
    try:
        limits(arguments.nominal / 1000)
    except ValueError as error:
        raise UserError(f'--nominal: {error}') from None
    return arguments.nominal / 1000
