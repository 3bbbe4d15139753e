# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Identity of a verified machine: digests of its program, parameters and audit log."""

from collections.abc import Iterable, Iterator, Sequence
import hashlib
from importlib.metadata import version
import json
from pathlib import Path

from checkweigher_bringup.spinning import write_parameter_file
from checkweigher_core.changes import CALIBRATION
from checkweigher_core.printable import one_line
from checkweigher_production.audit_log import AuditError, Entry, read_log
from checkweigher_recording.simulation.operation import OPERATION
from checkweigher_validation.archive.program import program_digest
from checkweigher_validation.verification.procedure import digest_of

NodeValues = dict[str, dict[str, object]]  # parameters by node and name

_LONGEST = 80  # maximum number of characters of a parameter value in a sentence
_PACKAGES = ('core', 'dsp', 'production', 'recording', 'driver', 'validation', 'web', 'bringup')
# Kinds of audit log entries that record a change of the machine. The kind `zero` is left out,
# because steps of the verification set the zero.
_CHANGING = ('parameter', 'recipe', 'calibration', 'learned', 'tuned', 'selection')


class Identity:
    """Identity of a machine, from its audit log and its parameters.

    The parameters are written to the path `file`. `audit` is the path of the audit log, or None if
    the machine has no log. Raises `AuditError` if the log cannot be read or its chain is broken.
    """

    def __init__(self, file: Path, audit: Path | None) -> None:
        self._file = file
        self._audit = audit
        digests, entries = _read_audit(audit)
        self._known = dict[str, object](digests)
        known = [each.new for each in entries if each.kind == CALIBRATION]
        self._known['audit_log_calibration'] = digest_of(known[-1]) if known else None
        self._entries = len(entries)  # number of entries before the first step
        self._values: NodeValues = {}

    def at_begin(self, values: NodeValues, how: str) -> str:
        """Write the parameter file, and return the identity before the first step as JSON.

        `values` contains the parameters by node and name. `how` is a phrase that states whether the
        steps are performed on a running line or were recorded one by one.
        """
        write_parameter_file(self._file, values)
        self._values = values
        self._known |= {
            'program': f'checkweigher {version("checkweigher_bringup")}',
            'program_sha256': program_digest(_PACKAGES),
            'parameters_sha256': hashlib.sha256(self._file.read_bytes()).hexdigest(),
            'how': how,
            'parameters': self._file.read_text(encoding='utf-8'),
            'changes': None,
        }
        return json.dumps(self._known)

    def at_end(self, values: NodeValues) -> str:
        """Return the identity after the last step as JSON, with the changes during the steps.

        If the audit log can no longer be used, one of the changes is a sentence that states this.
        """
        changes = list(_changes(self._values, values))
        try:
            digests, entries = _read_audit(self._audit)
            self._known |= digests
            changes += _changes_in_log(entries[self._entries :])
        except AuditError as error:  # a damaged log must not prevent the report
            changes.append(f'The audit log cannot be used after the last step: {one_line(error)}.')
        self._known['changes'] = changes
        return json.dumps(self._known)


def _changes(before: NodeValues, after: NodeValues) -> Iterator[str]:
    """Yield a sentence for each parameter that changed during the steps.

    The parameters that operate a simulated machine are left out. A user sets them during a step,
    for example to put a load on the belt, so they are no change of the machine.

    A node that reported its parameters only before or only after the steps gives one sentence.
    """
    for node in sorted({*before, *after}):
        if node not in before or node not in after:
            when = 'before the first' if node in before else 'after the last'
            yield f'Node {node} reported its parameters only {when} step.'
            continue
        old, new = before[node], after[node]
        for name in sorted({*old, *new}):
            if name.startswith(OPERATION):
                continue
            was, now = (
                repr(values[name]) if name in values else 'not set' for values in (old, new)
            )
            if was != now:
                yield (
                    f'Parameter {node}.{name} was {one_line(was, _LONGEST)} before the first step '
                    f'and {one_line(now, _LONGEST)} after the last step.'
                )


def _changes_in_log(entries: Iterable[Entry]) -> Iterator[str]:
    """Yield a sentence for each audit log entry that records a change of the machine.

    Entries on the operation of a simulated machine are left out, as in `_changes`.
    """
    for entry in entries:
        operates = entry.kind == 'parameter' and OPERATION in entry.subject
        if operates or entry.kind not in _CHANGING:
            continue
        what = f'{entry.kind} {entry.subject} of {entry.source}'
        parts = entry.time, what, repr(entry.old), repr(entry.new), entry.who or 'not known'
        time, subject, old, new, who = (one_line(part, _LONGEST) for part in parts)
        yield f'Audit log, {time}: {subject} from {old} to {new}, by {who}.'


def _read_audit(path: Path | None) -> tuple[dict[str, str | None], Sequence[Entry]]:
    """Return a dict with the path, the SHA-256 and the last hash of an audit log, and the entries.

    The last hash is None if the log has no entries. If `path` is None, the three values of the dict
    are None, and there are no entries.

    Raises `AuditError` if the log cannot be read, or its chain is broken.
    """
    if path is None:
        return dict.fromkeys(('audit_log', 'audit_log_sha256', 'audit_log_last_hash')), ()
    found = read_log(path)
    if not found.whole:
        raise AuditError(f'{path}: the chain is broken at line {found.bad_line}: {found.reason}')
    digests = {
        'audit_log': str(path),
        'audit_log_sha256': found.sha256,
        'audit_log_last_hash': found.entries[-1].hash if found.entries else None,
    }
    return digests, found.entries
