# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches and entries of the audit log that a person may sign.

The entries that may be signed are the results of verifications, changes of recipes, and changes of
the limits of the node `reject`.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from checkweigher_core.changes import PARAMETER, RECIPE, SELECTION, VERIFICATION
from checkweigher_core.printable import one_line
from checkweigher_dsp.rejection.parameters import LIMITS
from checkweigher_production.audit_chain import read_chain
from checkweigher_production.audit_log import Entry
from checkweigher_production.audit_words import changes, shortened
from checkweigher_validation.batch.batch import read_recorded
from checkweigher_validation.batch.signatures import (
    RELEASE,
    Signature,
    Signer,
    entry_signatures,
    foreign_keys,
    lacking,
    sign,
    signature_faults,
)
from checkweigher_validation.verification.kept_files import verification_faults
from checkweigher_validation.verification.plan import VERIFICATIONS

_MOST = 3  # largest number of changes in the title of an entry


class SigningError(ValueError):
    """Raised if a signature is refused. The message states the reason."""


@dataclass(frozen=True, slots=True)
class Signable:
    """Batch record or audit log entry that a person may sign."""

    title: str
    subject: str  # subject of the audit log entries that contain the signatures
    batch: str | None  # name of the batch, None for an entry
    sha256: str  # SHA-256 of the record or of the entry, hexadecimal
    persons: int  # number of persons who must have signed when the record or entry is released
    signatures: tuple[Signature, ...] = ()

    def signature(self, key: Ed25519PrivateKey, meaning: str, who: str, time: str) -> Signature:
        """Return the signature of a person on this record or entry.

        Raises `SigningError` if the signature is a release, and signatures of others are missing.
        """
        made = sign(key, self.batch, meaning, who, time, self.sha256)
        lacks = lacking((*self.signatures, made), self.persons)
        if meaning == RELEASE and lacks:
            raise SigningError(f'{self.title} cannot be released: {lacks}')
        return made


def signable_batch(record: Path, log: Path | None = None) -> Signable:
    """Return the batch of a record, to be signed.

    `log` is the audit log as in `read_recorded`. Raises `SigningError` if the batch has not ended
    or the record cannot be trusted, `RecordError` if the record cannot be read, and `AuditError` if
    the log cannot be read.
    """
    batch = read_recorded(record, log)
    title = f'batch {one_line(batch.name)}'
    if not batch.end:
        raise SigningError(f'{title} has not ended yet')
    if batch.faults:
        raise SigningError(f'{title} cannot be signed: {batch.faults[0]}')
    return Signable(title, batch.name, batch.name, batch.sha256, batch.persons, batch.signatures)


def signable_entry(log: Path, digest: str) -> Signable:
    """Return the entry of an audit log with the hash `digest`, to be signed.

    Raises `SigningError` if there is no such entry, if it may not be signed, if the log or an
    earlier log was changed, or if the entry belongs to a verification whose files were changed.
    Raises `AuditError` if the log cannot be read.
    """
    chain = read_chain(log)
    if chain.fault:
        raise SigningError(chain.fault)
    found = [each for each in signable_entries(chain.entries) if each.sha256 == digest]
    if not found:
        raise SigningError(
            f'{log.name}: this entry is neither a change of limits or recipes nor a verification'
        )
    for entry in chain.entries:
        if (entry.hash, entry.kind) == (digest, VERIFICATION):
            folder = log.parent / VERIFICATIONS / Path(entry.subject).name
            for fault in verification_faults(folder, entry.new):
                raise SigningError(f'the entry cannot be signed: {fault}')
    return found[0]


def signable_entries(entries: Sequence[Entry]) -> list[Signable]:
    """Return the entries of an audit log that may be signed, oldest first."""
    signed: dict[str, list[Signature]] = defaultdict(list)
    for signature in entry_signatures(entries):
        signed[signature.sha256].append(signature)
    return [
        Signable(
            f'{_title(entry)}, {entry.time[:19]}',
            f'entry {entry.sequence}',
            None,
            entry.hash,
            persons,
            tuple(signed[entry.hash]),
        )
        for entry, persons in _may_be_signed(entries)
    ]


def _may_be_signed(entries: Sequence[Entry]) -> Iterator[tuple[Entry, int]]:
    """Yield the entries that may be signed, each with the number of persons its release requires.

    The number is `release_by` of the recipe, or 1 for a verification. For a change of limits, the
    number is taken from the recipe of the selected product. For a change of a recipe, the larger of
    the old and the new number applies, so that no single person can lower the number.
    """
    asked: dict[str, int] = {}  # number of persons that a release requires, by product
    product = ''
    for entry in entries:
        new: Mapping[str, Any] = entry.new if isinstance(entry.new, dict) else {}
        if entry.kind == SELECTION:
            product = str(new.get('product', ''))
        elif entry.kind == RECIPE:
            before, now = asked.get(entry.subject, 1), new.get('release_by')
            asked[entry.subject] = now if isinstance(now, int) else 1
            yield entry, max(before, asked[entry.subject])
        elif entry.kind == VERIFICATION:
            yield entry, 1
        elif entry.kind == PARAMETER and entry.subject.partition('.')[2] in LIMITS:
            yield entry, asked.get(product, 1)


def _title(entry: Entry) -> str:
    if entry.kind == VERIFICATION and isinstance(entry.new, dict):
        return f'verification {one_line(entry.subject)}: {shortened(entry.new.get("verdict"))}'
    made = [f'{one_line(what)}: {shortened(a)} -> {shortened(b)}' for what, a, b in changes(entry)]
    more = ', ...' if len(made) > _MOST else ''
    return f'{entry.kind} {", ".join(made[:_MOST])}{more}'


def entry_signature_faults(
    entries: Sequence[Entry], signers: Mapping[str, Signer] | None = None
) -> Iterator[str]:
    """Yield a sentence for each void signature on an entry, also if the log lacks the entry.

    `signers` contains the users by name. If `signers` is None, the keys are not compared with the
    keys of the users.
    """
    known = set[str]()
    for each in signable_entries(entries):
        known.add(each.sha256)
        faults = [*signature_faults(each.signatures, None, each.sha256, each.persons)]
        faults += [] if signers is None else foreign_keys(each.signatures, signers)
        yield from (f'{each.title}: {fault}' for fault in faults)
    for signature in entry_signatures(entries):
        if signature.sha256 not in known:
            yield (
                f'the {one_line(signature.meaning)} by {one_line(signature.who)} is void: the '
                'audit log does not have the entry that was signed'
            )
