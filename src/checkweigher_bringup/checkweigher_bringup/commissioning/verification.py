# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verification of a machine by a plan, with a bag of the procedure and a report."""

import argparse
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
import queue
import shutil
from typing import NamedTuple

from rclpy.node import Node

from checkweigher_bringup.commissioning.identity import Identity
from checkweigher_bringup.commissioning.lane_client import technician, write_to_log
from checkweigher_bringup.commissioning.terminal import StepsAtTerminal
from checkweigher_bringup.commissioning.verification_bags import procedure_of_bags
from checkweigher_bringup.commissioning.verification_guide import procedure_on_line
from checkweigher_bringup.commissioning.verification_operator import Operator
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.settings import check_namespace, line_parameters
from checkweigher_bringup.spinning import spinning
from checkweigher_core.changes import VERIFICATION
from checkweigher_core.input_files import sha256_of
from checkweigher_core.records import ProgressState, VerificationProgress
from checkweigher_core.ros.services import VERIFIER
from checkweigher_core.ros.spinner import Spinner
from checkweigher_core.whole_file import check_new, make_output_folder, write_whole
from checkweigher_production.audit_chain import read_chain
from checkweigher_recording.archive.copying import local_bag
from checkweigher_recording.bags.results import mcap_digest
from checkweigher_validation.verification.plan import Plan, read_plan
from checkweigher_validation.verification.procedure import read_procedure
from checkweigher_validation.verification.report import as_json, report_of


class Conclusion(NamedTuple):
    """Verdict of a verification, and a sentence for each departure from the rules."""

    verdict: str
    departures: tuple[str, ...]


def verify(arguments: argparse.Namespace) -> Conclusion:
    """Run a procedure and write its report, or write the report again from the bag of a procedure.

    A clause after the verdict states if the verdict could not be written to the audit log, or if
    the audit log does not confirm the bag and the verdict.
    """
    folder: Path = arguments.output
    if arguments.params is not None and not arguments.bags:
        raise UserError('--params: only with --bags; a running line has its own parameters')
    check_new(folder)
    if arguments.plan is None:
        with local_bag(arguments.procedure) as recorded:
            verdict, departures = write_report(recorded, folder)
            unlike = _unlike_log(arguments.audit, mcap_digest(recorded), verdict)
            return Conclusion(verdict + unlike, departures)
    plan, text = plan_of(arguments.plan)
    namespace = check_namespace(arguments.namespace)
    parameters = line_parameters(arguments.params, None)

    def make(identity: Identity, bag: Path) -> None:
        if arguments.bags:
            procedure_of_bags(plan, text, arguments.bags, parameters, identity, bag)
            return
        with spinning(namespace, VERIFIER) as spinner:
            _procedure_at_terminal(spinner, plan, text, identity, bag)

    verdict, departures = report_on(make, folder, arguments.audit)
    if not arguments.bags and arguments.audit is not None:
        with technician(namespace) as node:
            verdict += note_result(node, folder, plan, verdict)
    return Conclusion(verdict, departures)


def _procedure_at_terminal(
    spinner: Spinner, plan: Plan, text: str, identity: Identity, bag: Path
) -> None:
    """Guide an operator at this terminal through a procedure, which another thread runs.

    Raises the exceptions of `procedure_on_line`. Also raises `UserError` if the standard input
    ends; in this case, the bag contains the steps so far.
    """
    said: queue.SimpleQueue[VerificationProgress | None] = queue.SimpleQueue()  # None at the end
    operator = Operator(VerificationProgress(0, ProgressState.MAKING), said.put)
    steps = StepsAtTerminal(operator.answer)
    with ThreadPoolExecutor(1) as pool:
        made = pool.submit(procedure_on_line, spinner, plan, text, identity, bag, operator)
        made.add_done_callback(lambda _: said.put(None))
        try:
            while (progress := said.get()) is not None:
                steps.follow(progress)
        except BaseException:
            operator.break_off()
            raise
    made.result()


def note_result(node: Node, folder: Path, plan: Plan, verdict: str) -> str:
    """Write the result of a verification to the audit log of the line.

    Returns the reason why the result could not be written, or an empty string.
    """
    files = [folder / f'report.{ending}' for ending in ('html', 'json')]
    value = {
        'verdict': verdict,
        'bag': mcap_digest(folder / 'bag'),
        **{each.name: sha256_of(each) for each in files},
    }
    try:
        write_to_log(node, VERIFICATION, folder.name, value, plan.operator)
    except UserError as error:
        return f', but it is not in the audit log: {error}'
    return ''


def _unlike_log(log: Path | None, bag: str, verdict: str) -> str:
    """Return a text that states how a bag and its verdict differ from an audit log.

    `bag` is the digest of the bag. The text is empty if the log confirms the bag and the verdict,
    or if `log` is None.
    """
    if log is None:
        return ''
    chain = read_chain(log)
    if chain.fault:
        return f', but {chain.fault}'
    made = [e.new for e in chain.entries if e.kind == VERIFICATION and isinstance(e.new, dict)]
    known = [each.get('verdict') for each in made if each.get('bag') == bag]
    if not known:
        return f', but the audit log {chain.identity} has no verification with this bag'
    return '' if verdict in known else f', but it was {known[-1]} when it was made'


def report_on(
    make: Callable[[Identity, Path], None], folder: Path, audit: Path | None
) -> Conclusion:
    """Run a procedure, write its report into a new folder, and return the conclusion.

    The function `make` runs the procedure. The arguments of `make` are the identity of the machine
    and the path of the bag to write. `audit` is the path of the audit log of the line, or None if
    the line has no log. If `make` raises an exception before it has written a bag, the folder is
    removed, and the exception is raised again. If `make` raises an exception after it has written a
    bag, the bag is kept without a report.
    """
    bag, identity = folder / 'bag', Identity(folder / 'parameters.yaml', audit)
    make_output_folder(folder)
    try:
        make(identity, bag)
    finally:
        if not bag.exists():
            shutil.rmtree(folder, ignore_errors=True)
    return write_report(bag, folder)


def write_report(bag: Path, folder: Path) -> Conclusion:
    """Write the report of a procedure into a folder as JSON and HTML, and return the conclusion.

    `bag` is the path of the bag of the procedure. The folder is created if it is missing.

    Raises `BagError` if the bag cannot be used, and `OutputError` if a file cannot be written.
    """
    # Import this module only here, because its libraries double the memory of the node `verifier`.
    from checkweigher_validation.report.verification_page import render_verification

    report = report_of(read_procedure(bag))
    make_output_folder(folder, exist_ok=True)
    write_whole(folder / 'report.json', as_json(report))
    write_whole(folder / 'report.html', render_verification(report))
    return Conclusion(report['verdict'], tuple(report['departures']))


def plan_of(path: Path) -> tuple[Plan, str]:
    """Return the plan in a file, and the text of the file.

    Raises `UserError` if the file is not a valid plan, and `OSError` if it cannot be read.
    """
    try:
        text = path.read_text(encoding='utf-8')
        return read_plan(text), text
    except ValueError as error:
        raise UserError(f'{path}: {error}') from None
