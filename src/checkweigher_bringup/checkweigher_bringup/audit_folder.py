# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Comparison of the documents in the folder of a machine with the audit logs of the machine.

The documents are the batch records, the batch reports and the verifications.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import date, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

from checkweigher_core.changes import RECORD, REPORT, VERIFICATION
from checkweigher_core.printable import one_line
from checkweigher_production.audit_chain import LogChain, logs_in
from checkweigher_production.audit_log import Entry
from checkweigher_production.audit_words import conclusion, steps_back
from checkweigher_production.batch_record import SUFFIX, RecordError, record_path
from checkweigher_validation.batch.batch import read_record
from checkweigher_validation.batch.signatures import Signer, foreign_keys
from checkweigher_validation.batch.signing import entry_signature_faults
from checkweigher_validation.verification.kept_files import file_faults, verification_faults
from checkweigher_validation.verification.plan import VERIFICATIONS

BATCHES = 'batches'


def faults_in(
    folder: Path, chain: LogChain, signers: Mapping[str, Signer] | None = None
) -> Iterator[str]:
    """Yield a text for each fault in the folder of a machine.

    A fault is an audit log that is broken, missing, or not named by a later log. A fault is also a
    document that is missing or changed, a batch record or verification that the audit logs do not
    name, or an invalid signature. `chain` contains the audit logs. `signers` contains the users by
    name. If `signers` is None, the keys of the signatures are not compared with the keys of the
    users.
    """
    entries = chain.entries
    if chain.fault:
        yield chain.fault
    known = {path.name for path, _ in chain.logs}
    for path in logs_in(folder):
        if path.name not in known:
            yield f'{path.name}: no later log names it'
    yield from _batch_faults(folder / BATCHES, chain, signers)
    yield from entry_signature_faults(entries, signers)
    for batch, files in _latest(entries, REPORT).items():
        yield from file_faults(folder / BATCHES, f'report on batch {one_line(batch)!r}', files)
    made = _latest(entries, VERIFICATION)
    for name, values in made.items():
        yield from verification_faults(folder / VERIFICATIONS / Path(name).name, values)
    for path in sorted((folder / VERIFICATIONS).glob('*/bag')):
        if path.parent.name not in made:
            yield f'verification {path.parent.name}: the audit log does not know it'


def _batch_faults(
    folder: Path, chain: LogChain, signers: Mapping[str, Signer] | None
) -> Iterator[str]:
    """Yield a text for each fault of a batch record, and for each missing batch record.

    A record is missing if `chain` names the batch, but the folder does not contain the record.
    `signers` is used as in `faults_in`.
    """
    for name in _latest(chain.entries, RECORD):
        with suppress(RecordError):
            if not record_path(folder, name).exists():
                yield f'batch {one_line(name)!r}: its record is missing'
    for path in sorted(folder.glob(f'*{SUFFIX}')):
        try:
            batch = read_record(path).with_log(chain, path.read_bytes())
            foreign = () if signers is None else foreign_keys(batch.signatures, signers)
            faults = (*batch.faults, *foreign)
        except (OSError, RecordError) as error:
            faults = (str(error),)
        # `faults_in` has already yielded the fault of the log, so it is not repeated here.
        yield from (f'{path.name}: {one_line(each)}' for each in faults if each != chain.fault)


def summary(folder: Path, chain: LogChain) -> Iterator[str]:
    """Yield lines of text on the audit logs, on the documents, and on days without an entry.

    For each log, the lines state whether it is valid, and at which entries the time goes back. One
    line states how many batch records, batch reports and verifications the logs name. The last line
    lists the days without an entry, and is left out if there are none.
    """
    for path, found in chain.logs:
        yield f'{path.name}: {conclusion(found)}'
        yield from (f'{path.name}: {each}' for each in steps_back(found.entries))
    entries = chain.entries
    counts = ((kind, len(_latest(entries, kind))) for kind in (RECORD, REPORT, VERIFICATION))
    known = ', '.join(f'{kind} {count}' for kind, count in counts)
    yield f'{folder}: number of each kind in the audit log: {known}'
    if silent := ', '.join(_silent_days(entries)):
        yield f'days without an entry: {silent}'


def _silent_days(entries: list[Entry]) -> Iterator[str]:
    """Yield each day or span of days without an entry, between the first and the last entry."""
    days = set[date]()
    for entry in entries:
        with suppress(ValueError):
            days.add(date.fromisoformat(entry.time[:10]))
    for day, following in pairwise(sorted(days)):
        if following - day > timedelta(1):
            last = following - timedelta(1)
            yield f'{day + timedelta(1)}' + (f' to {last}' if last > day + timedelta(1) else '')


def _latest(entries: list[Entry], kind: str) -> Mapping[str, Any]:
    """Return the new value of each subject in its latest entry of the kind `kind`, by subject."""
    return {entry.subject: entry.new for entry in entries if entry.kind == kind}
