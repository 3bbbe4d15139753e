# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verify a machine: a procedure on a running line or from bags, and its report."""

import argparse
from pathlib import Path
import sys

from checkweigher_bringup.commands import add_namespace, add_parameter_file
from checkweigher_bringup.errors import UserError


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
        type=Path,
        metavar='BAG',
        help='make the same report again, from the bag of a whole procedure',
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

    verdict = verification.verify(arguments)
    print(f'{arguments.output}: {verdict}; {arguments.output / "report.html"} has every reading')
    return 0 if verdict == 'passed' else 1


def _show_steps(path: Path) -> int:
    """Print the steps of a plan, one a line."""
    from checkweigher_bringup.commissioning.verification import plan_of
    from checkweigher_validation.verification.steps import steps_of

    plan, _ = plan_of(path)
    for step in steps_of(plan):
        count = f'{step.count} passes' if step.count else 'reading'
        sys.stdout.write(f'{step.name:24} {count:>10}  {step.to_do}\n')
    return 0
