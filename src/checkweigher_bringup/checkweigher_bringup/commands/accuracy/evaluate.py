# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of the estimators on passes of known mass."""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import add_parameter_file, add_tuning

EXAMPLES = ('evaluate shift*/ --params machine.yaml --csv accuracy.csv',)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `evaluate`."""
    add = parser.add_argument_group('what is weighed').add_argument
    add(
        'bags',
        nargs='*',
        metavar='BAG',
        help='bags with reference_mass: folders, .mcap files, URLs, or folders with bags in them',
    )
    add('--protocol', choices=('paper', 'machines'),
        help='instead of bags simulate, tune on one part of the passes and test on another. paper: '
        '5 speeds x 5 masses on the machine of a profile; machines: 3 speeds on machines drawn '
        'from a family, beside what is attainable on each')  # fmt: skip
    add('--profile', metavar='NAME',
        help='machine of the protocol paper: paper (default), roller, soft, floor or '
        'quiet')  # fmt: skip
    add('--passes', type=int, default=120, metavar='N',
        help='paper: of each mass at each speed; machines: at each speed to tune on, 120 others '
        'test; default 120')  # fmt: skip
    add('--seed', type=int, default=1, metavar='S',
        help='of the protocol; of the first of the machines')  # fmt: skip
    add('--count', type=int, default=3, metavar='N',
        help='machines, those with the seeds from S on; default 3')  # fmt: skip
    add('--further', type=int, default=1500, metavar='N',
        help='passes of each machine at each speed that teach what is attainable; fewer are faster '
        'and show less of it; default 1500')  # fmt: skip
    add('--without', nargs='+', action='extend', metavar='CAUSE', default=[],
        help='causes that the machines lack: transfer, bounce, rollers and so on')  # fmt: skip
    add('--mass', type=float, nargs='+', action='extend', metavar='G',
        help='masses that the machines are tuned on, g; default the five that test')  # fmt: skip
    how = parser.add_argument_group('how it is weighed')
    how.add_argument('--train', nargs='+', action='extend', metavar='BAG',
                     help='tune on these bags first; BAG then are the test')  # fmt: skip
    add_parameter_file(how)
    add_tuning(how)
    add = parser.add_argument_group('how it is judged').add_argument
    add('--class', dest='accuracy_class', default='XIII', metavar='CLASS',
        help='of OIML R 51: XI, XII, XIII (default), XIIII, Y(I), Y(II), Y(a) or Y(b)')  # fmt: skip
    add('--factor', type=float, default=1.0, metavar='X', help='class factor x: 1, 2 or 5 x 10^k')
    add('--interval', type=float, metavar='G',
        help='verification scale interval e, g; default 0.1, or by --max')  # fmt: skip
    add('--max', dest='maximum', type=float, metavar='G',
        help='Max of the scale, g: e is the smallest that the class allows for it')  # fmt: skip
    add('--in-service', action='store_true', help='limits in service, not of initial verification')
    add('--nominal', type=float, metavar='G',
        help='nominal quantity, g: also show the limits of EU directive 76/211/EEC')  # fmt: skip
    add = parser.add_argument_group('what is written').add_argument
    for name, text in (
        ('html', 'report with tables and figures, one file'),
        ('csv', 'one row for each estimator, speed, mass and part'),
        ('json', 'the same with every error'),
        ('tuned', 'parameter file with what was tuned'),
    ):
        add(f'--{name}', type=Path, metavar='FILE', help=text)
    add('--overwrite', action='store_true', help='replace files that exist')


def run(arguments: argparse.Namespace) -> int:
    """Weigh, show the table and write the files that are asked for."""
    from checkweigher_bringup.evaluation import evaluate, evaluate_family
    from checkweigher_bringup.settings import on_scheduler_of

    work = evaluate_family if arguments.protocol == 'machines' else evaluate
    with on_scheduler_of(arguments) as n_jobs:
        return int(work(arguments, n_jobs) > 0)
