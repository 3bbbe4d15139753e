# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verify a machine: a procedure on a running line or from bags, and its report."""

import argparse
from pathlib import Path
import sys

from checkweigher_bringup.commands import add_namespace, add_parameter_file
from checkweigher_bringup.errors import UserError
from checkweigher_core.printable import one_line

EXAMPLES = ('verify --from 2026-05-28/bag 2026-06-28/bag --output again',)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `verify`."""
    add = parser.add_argument
    add(
        'plan',
        type=Path,
        nargs='?',
        metavar='PLAN',
        help='plan of the verification (YAML); on a running line the steps are asked for in turn',
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        '--bags',
        type=Path,
        nargs='+',
        action='extend',
        metavar='BAG',
        help='recorded steps, each bag named as its step, instead of a running line',
    )
    what.add_argument(
        '--from',
        dest='procedure',
        nargs='+',
        action='extend',
        metavar='BAG',
        help='make the same report again, from the bag of a whole procedure; of several bags, or '
        'a folder with bags in it, each in a folder of its own',
    )
    what.add_argument('--steps', action='store_true', help='show the steps of the plan')
    what.add_argument('--example', action='store_true', help='show a plan with comments')
    add(
        '--output',
        type=Path,
        metavar='DIR',
        help='new folder for report.html, report.json, the bag of the procedure and the parameters',
    )
    add_parameter_file(parser)
    add('--audit', type=Path, metavar='LOG', help='audit log of the line, whose digest is reported')
    add_namespace(parser)


def run(arguments: argparse.Namespace) -> int:
    """Make the procedure and the report; 0 if everything passed, 1 if not."""
    from checkweigher_validation.verification.plan import EXAMPLE

    if arguments.example:
        print(EXAMPLE, end='')
        return 0
    if (arguments.plan is None) == (arguments.procedure is None):
        raise UserError('a PLAN, or with --from BAG none; verify --example shows a plan')
    if arguments.steps:
        return _show_steps(arguments.plan)
    if arguments.output is None:
        raise UserError('--output: must be given')
    from checkweigher_bringup.commissioning import verification
    from checkweigher_recording.archive.finding import find_bags, result_names

    if arguments.procedure is not None:
        bags = find_bags(arguments.procedure)
        if len(bags) > 1:
            return _reports_of(result_names(bags), arguments)
        (arguments.procedure,) = bags
    verdict = verification.verify(arguments)
    print(f'{arguments.output}: {verdict}; {arguments.output / "report.html"} has every reading')
    return 0 if verdict == 'passed' else 1


def _reports_of(bags: dict[str, str], arguments: argparse.Namespace) -> int:
    """Make the reports of bags again, each by its name; 1 if one is not passed or not made."""
    from checkweigher_bringup.commissioning import verification
    from checkweigher_core.whole_file import check_new
    from checkweigher_recording.bags.definitions import BagError

    check_new(arguments.output)
    failed = 0
    for number, (bag, name) in enumerate(bags.items(), start=1):
        folder = arguments.output / name
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            one = argparse.Namespace(**vars(arguments) | {'procedure': bag, 'output': folder})
            verdict = verification.verify(one)
        except BagError as error:
            print(f'{one_line(error)}; passed over', file=sys.stderr, flush=True)
            verdict = 'passed over'
        failed += verdict != 'passed'
        print(f'{number} of {len(bags)}: {one_line(bag)}: {verdict}', flush=True)
    return int(failed > 0)


def _show_steps(path: Path) -> int:
    """Print the steps of a plan, one a line."""
    from checkweigher_bringup.commissioning.verification import plan_of
    from checkweigher_validation.verification.steps import steps_of

    plan, _ = plan_of(path)
    for step in steps_of(plan):
        count = f'{step.count} passes' if step.count else 'reading'
        sys.stdout.write(f'{step.name:24} {count:>10}  {step.to_do}\n')
    return 0
