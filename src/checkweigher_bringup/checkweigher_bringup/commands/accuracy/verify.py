# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verify the machine by the book, and write the report.

checkweigher verify plan.yaml --output /tmp/verification
checkweigher verify --from 2026-05-28/bag 2026-06-28/bag --output again
"""

import argparse
from pathlib import Path
import sys

from checkweigher_bringup.commands import NAMESPACE, PARAMS
from checkweigher_bringup.errors import UserError, warn
from checkweigher_core.printable import one_line

_PLAN = 'plan of the verification (YAML); on a running line the steps are asked for in turn'
_STEPS = 'recorded steps, each bag named as its step, instead of a running line'
OPTIONS = (
    ('plan PLAN', Path, _PLAN, {'nargs': '?'}),
    (
        ('--bags BAG', [Path], _STEPS),
        (
            '--from BAG',
            [str],
            'make the same report again, from the bag of a whole procedure; of several bags, or a '
            'folder with bags in it, each in a folder of its own',
            {'dest': 'procedure'},
        ),
        ('--steps', bool, 'show the steps of the plan'),
        ('--example', bool, 'show a plan with comments'),
    ),
    ('--output DIR', Path, 'new folder for the reports, the bag and the parameters'),
    PARAMS,
    (
        '--log,--audit LOG',
        Path,
        'audit log of the line, which is named in the report; with --from, it has to know the bag',
        {'dest': 'audit'},
    ),
    NAMESPACE,
)


def run(arguments: argparse.Namespace) -> int:
    """Run the procedure and write its report. Return 0 if everything passed, otherwise 1."""
    from checkweigher_validation.verification.plan import EXAMPLE

    if arguments.example:
        print(EXAMPLE, end='')
        return 0
    if (arguments.plan is None) == (arguments.procedure is None):
        raise UserError('give a PLAN, or with --from BAG none; verify --example shows a plan')
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
    """Write the report of each bag again, into a folder with the name of the bag.

    Returns 1 if a verification did not pass or a bag could not be read, otherwise 0.
    """
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
            warn(f'{error}; passed over')
            verdict = 'passed over'
        failed += verdict != 'passed'
        print(f'{number} of {len(bags)}: {one_line(bag)}: {verdict}', flush=True)
    return int(failed > 0)


def _show_steps(path: Path) -> int:
    from checkweigher_bringup.commissioning.verification import plan_of
    from checkweigher_validation.verification.steps import steps_of

    plan, _ = plan_of(path)
    for step in steps_of(plan):
        count = f'{step.count} passes' if step.count else 'reading'
        sys.stdout.write(f'{step.name:24} {count:>10}  {step.to_do}\n')
    return 0
