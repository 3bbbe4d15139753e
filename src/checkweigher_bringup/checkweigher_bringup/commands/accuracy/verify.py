# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verify a machine by the steps of a plan, and write the report.

Examples
--------
checkweigher verify plan.yaml
checkweigher verify plan.yaml --output /tmp/verification
checkweigher verify --from 2026-05-28/bag 2026-06-28/bag --output again
"""

import argparse
from pathlib import Path
import sys

from checkweigher_bringup.commands import NAMESPACE, PARAMS
from checkweigher_bringup.errors import UserError, warn
from checkweigher_core.printable import one_line

_PLAN = 'plan of the verification (YAML), whose steps an operator does on a running line'
_STEPS = 'bags of recorded steps instead of a running line; each bag has the name of its step'
OPTIONS = (
    ('plan PLAN', Path, _PLAN, {'nargs': '?'}),
    (
        ('--bags BAG', [Path], _STEPS),
        (
            '--from BAG',
            [str],
            'write the report again from the bag of a complete procedure; with several bags or a '
            'folder that contains bags, write each report to a folder of its own',
            {'dest': 'procedure'},
        ),
        ('--steps', bool, 'print the steps of the plan'),
        ('--example', bool, 'print an example of a plan with comments'),
    ),
    (
        '--output DIR',
        Path,
        'new folder for the reports, the bag and the parameters; default on a running line: a '
        'folder of the line, whose node verifier then runs the procedure',
    ),
    PARAMS,
    (
        '--log,--audit LOG',
        Path,
        'audit log of the line, whose name is written to the report; with --from, it must contain '
        'an entry on the bag',
        {'dest': 'audit'},
    ),
    NAMESPACE,
)


def run(arguments: argparse.Namespace) -> int:
    """Run the verification and write its report. Return 0 if everything passed, otherwise 1.

    With `--example` or `--steps`, print an example of a plan or the steps of the given plan, and
    return 0.
    """
    from checkweigher_validation.verification.plan import EXAMPLE

    if arguments.example:
        print(EXAMPLE, end='')
        return 0
    if (arguments.plan is None) == (arguments.procedure is None):
        raise UserError('give either PLAN or --from BAG; verify --example prints a plan')
    if arguments.steps:
        return _show_steps(arguments.plan)
    if arguments.output is None:
        return _verify_by_line(arguments)
    from checkweigher_bringup.commissioning import verification
    from checkweigher_recording.archive.finding import find_bags, result_names

    if arguments.procedure is not None:
        bags = find_bags(arguments.procedure)
        if len(bags) > 1:
            return _reports_of(result_names(bags), arguments)
        (arguments.procedure,) = bags
    conclusion = verification.verify(arguments)
    for departure in conclusion.departures:
        print(one_line(departure))
    return _tell(conclusion.verdict, arguments.output)


def _tell(verdict: str, folder: Path) -> int:
    """Print a verdict, and return the exit status: 0 for "passed", otherwise 1."""
    print(f'{folder}: {verdict}; {folder / "report.html"} has all readings')
    return 0 if verdict == 'passed' else 1


def _verify_by_line(arguments: argparse.Namespace) -> int:
    """Let the node `verifier` of a running line run the procedure, and print its verdict.

    Returns 0 if the verdict is "passed", otherwise 1. Raises `UserError` if an option that needs
    `--output` was given, or the line does not perform the verification.
    """
    from checkweigher_bringup.commissioning.line_guide import verify_line
    from checkweigher_bringup.commissioning.verification import plan_of
    from checkweigher_bringup.settings import check_namespace

    for option in ('bags', 'procedure', 'params', 'audit'):
        if getattr(arguments, option):
            raise UserError('--output: must be given with --bags, --from, --params or --log')
    _, text = plan_of(arguments.plan)
    verdict, folder = verify_line(check_namespace(arguments.namespace), text)
    return _tell(verdict, Path(folder))


def _reports_of(bags: dict[str, str], arguments: argparse.Namespace) -> int:
    """Write the report of each bag again, each into a folder of its own in the output folder.

    `bags` contains, for each bag, the path of its folder relative to the output folder. Bags that
    cannot be read are reported on stderr and skipped.

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
            verdict = verification.verify(one).verdict
        except BagError as error:
            warn(f'{error}; skipped')
            verdict = 'skipped'
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
