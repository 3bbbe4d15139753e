# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A verification and its files: the plan, what is verified, the procedure, the report."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
import hashlib
from importlib.metadata import version
import json
from pathlib import Path
import shutil

from checkweigher_bringup.commissioning.verification_bags import (
    Identity,
    NodeValues,
    procedure_of_bags,
)
from checkweigher_bringup.commissioning.verification_guide import procedure_on_line
from checkweigher_bringup.commissioning.verification_terminal import Terminal
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.output import make_folder
from checkweigher_bringup.settings import check_namespace, line_parameters
from checkweigher_bringup.spinning import spinning, write_parameter_file
from checkweigher_core.printable import one_line
from checkweigher_core.whole_file import check_new, write_whole
from checkweigher_production.audit_log import AuditError, Entry, read_log
from checkweigher_recording.archive.copying import local_bag
from checkweigher_validation.archive.program import program_digest
from checkweigher_validation.verification.plan import Plan, read_plan
from checkweigher_validation.verification.procedure import read_procedure
from checkweigher_validation.verification.report import as_json, report_of

_LONGEST = 80  # characters of a value in a sentence
# Kinds of entries that make it another machine; the zero is a step.
_CHANGING = ('parameter', 'recipe', 'calibration', 'learned', 'tuned', 'selection')
_PACKAGES = ('dsp', 'recording', 'driver', 'validation', 'web', 'bringup')


def verify(arguments: argparse.Namespace) -> str:
    """Make a procedure and its report, or the report of a procedure again; return the verdict."""
    folder: Path = arguments.output
    if arguments.params is not None and not arguments.bags:
        raise UserError('--params: only with --bags; a running line has its own parameters')
    check_new(folder)
    if arguments.plan is None:
        if arguments.audit is not None:
            raise UserError('--audit: not with --from, the bag has the digest of its log')
        with local_bag(arguments.procedure) as recorded:
            return write_report(recorded, folder)
    plan, text = plan_of(arguments.plan)
    namespace = check_namespace(arguments.namespace)
    parameters = line_parameters(arguments.params, None)

    def make(identity: Identity, bag: Path) -> None:
        if arguments.bags:
            procedure_of_bags(plan, text, arguments.bags, parameters, identity, bag)
            return
        with spinning(namespace) as spinner:
            procedure_on_line(spinner, plan, text, identity, bag, Terminal())

    return report_on(make, folder, arguments.audit)


def report_on(make: Callable[[Identity, Path], None], folder: Path, audit: Path | None) -> str:
    """Make a procedure and its report in a folder that is made; return the verdict.

    `make` gets what gives the identity, and the path of the bag; `audit` is the log of the line.
    """
    bag, identity = folder / 'bag', _IdentityOnDisk(folder / 'parameters.yaml', audit)
    make_folder(folder)
    try:
        make(identity, bag)
    finally:
        if not bag.exists():  # nothing was recorded
            shutil.rmtree(folder, ignore_errors=True)
    return write_report(bag, folder)


class _IdentityOnDisk:
    """What is verified, by the audit log and a file of the parameters, which it writes.

    OSError or AuditError if the log cannot be read, or its chain is broken.
    """

    def __init__(self, file: Path, audit: Path | None) -> None:
        self._file = file
        self._audit = audit
        digests, entries = _read_audit(audit)
        self._known = dict[str, object](digests)
        self._entries = len(entries)  # before the first step
        self._values: NodeValues = {}

    def at_begin(self, values: NodeValues, how: str) -> str:
        write_parameter_file(self._file, values)
        self._values = values
        self._known |= {
            'program': f'checkweigher {version("checkweigher_bringup")}',
            'program_sha256': program_digest(_PACKAGES),
            'parameters_sha256': hashlib.sha256(self._file.read_bytes()).hexdigest(),
            'how': how,
            'changes': None,
        }
        return json.dumps(self._known)

    def at_end(self, values: NodeValues) -> str:
        changes = list(_changes(self._values, values))
        try:  # the steps themselves are in the log: the zero, and on the page each answer
            digests, entries = _read_audit(self._audit)
            self._known |= digests
            changes += _changes_in_log(entries[self._entries :])
        except (AuditError, OSError) as error:  # the procedure is worth its report all the same
            changes.append(f'The audit log cannot be used after the last step: {one_line(error)}.')
        self._known['changes'] = changes
        return json.dumps(self._known)


def _changes(before: NodeValues, after: NodeValues) -> Iterator[str]:
    """Yield a sentence for each parameter that is another one after the last step."""
    for node in sorted({*before, *after}):
        if node not in before or node not in after:
            when = 'before the first' if node in before else 'after the last'
            yield f'Node {node} told its parameters only {when} step.'
            continue
        old, new = before[node], after[node]
        for name in sorted({*old, *new}):
            was, now = (_shown(values, name) for values in (old, new))
            if was != now:
                yield (
                    f'Parameter {node}.{name} was {one_line(was, _LONGEST)} before the first step '
                    f'and {one_line(now, _LONGEST)} after the last one.'
                )


def _changes_in_log(entries: Iterable[Entry]) -> Iterator[str]:
    """Yield a sentence for each entry that made it another machine."""
    for entry in entries:
        if entry.kind not in _CHANGING:
            continue
        what = f'{entry.kind} {entry.subject} of {entry.source}'
        parts = entry.time, what, repr(entry.old), repr(entry.new), entry.who or 'not known'
        time, subject, old, new, who = (one_line(part, _LONGEST) for part in parts)
        yield f'Audit log, {time}: {subject} from {old} to {new}, by {who}.'


def _shown(values: dict[str, object], name: str) -> str:
    return repr(values[name]) if name in values else 'not there'


def write_report(bag: Path, folder: Path) -> str:
    """Write the report of a procedure into a folder, which is made; return the verdict."""
    # Its libraries take as much memory as the node verifier without them.
    from checkweigher_validation.report.verification_page import render_verification

    report = report_of(read_procedure(bag))
    make_folder(folder, exist_ok=True)
    write_whole(folder / 'report.json', as_json(report))
    write_whole(folder / 'report.html', render_verification(report))
    return str(report['verdict'])


def plan_of(path: Path) -> tuple[Plan, str]:
    """Return the plan of a file, and its text."""
    try:
        text = path.read_text(encoding='utf-8')
        return read_plan(text), text
    except OSError as error:
        raise UserError(f'{path}: {error.strerror or error}') from None
    except ValueError as error:
        raise UserError(f'{path}: {error}') from None


def _read_audit(path: Path | None) -> tuple[dict[str, str | None], Sequence[Entry]]:
    """Return name, digest and last hash of an audit log, which must be whole, and its entries."""
    if path is None:
        return dict.fromkeys(('audit_log', 'audit_log_sha256', 'audit_log_last_hash')), ()
    while True:  # until no entry has come in between
        before, found = path.read_bytes(), read_log(path)
        if path.read_bytes() == before:
            break
    if not found.whole:
        raise AuditError(f'{path}: the chain is broken at line {found.bad_line}: {found.reason}')
    digests = {
        'audit_log': str(path),
        'audit_log_sha256': hashlib.sha256(before).hexdigest(),
        'audit_log_last_hash': found.entries[-1].hash if found.entries else None,
    }
    return digests, found.entries
