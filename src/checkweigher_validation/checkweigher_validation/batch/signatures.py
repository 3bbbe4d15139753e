# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Electronic signatures on batches and audit log entries (21 CFR 11.50 and 11.70).

A signature is an entry of the audit log. The entry contains the name of the person, the time, the
meaning, and the SHA-256 of a batch record or of another entry, such as a change of limits. The
values in the entry are signed with an Ed25519 key that is derived from the password of the person.
A signature is void if it is copied to another record or entry, or if the signed record or entry is
changed afterwards.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
import json
from typing import Any, NamedTuple

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from checkweigher_core.changes import SIGNATURE
from checkweigher_production.audit_log import Entry

REVIEW, APPROVAL, RELEASE = 'review', 'approval', 'release'
MEANINGS = REVIEW, APPROVAL, RELEASE


@dataclass(frozen=True, slots=True)
class Signature:
    """Signature of a person on a batch record or an audit log entry."""

    batch: str | None  # name of the batch, None if an entry was signed
    meaning: str  # one of MEANINGS
    who: str  # name of the person
    time: str  # ISO 8601, UTC
    sha256: str  # SHA-256 of the record or of the entry, hexadecimal
    key: str  # Ed25519 public key, hexadecimal
    signature: str = ''  # Ed25519 signature of all other fields, hexadecimal

    @property
    def value(self) -> dict[str, str]:
        """Value of the signature in the audit log, without a batch if an entry was signed."""
        return {name: text for name, text in asdict(self).items() if text is not None}

    def signed(self) -> bytes:
        """Return the bytes to be signed: JSON of all fields, with an empty signature."""
        return json.dumps(replace(self, signature='').value, separators=(',', ':')).encode()

    @property
    def is_genuine(self) -> bool:
        """Whether `signature` was made with the private key that belongs to `key`."""
        try:
            key = Ed25519PublicKey.from_public_bytes(bytes.fromhex(self.key))
            key.verify(bytes.fromhex(self.signature), self.signed())
        except (ValueError, InvalidSignature):
            return False
        return True


class Signer(NamedTuple):
    """User in the users file who may sign."""

    keys: tuple[str, ...]  # Ed25519 public keys, hexadecimal
    may_release: bool  # whether the user may also sign with the meaning RELEASE


def public_hex(key: Ed25519PrivateKey) -> str:
    """Return the public key of a private key, hexadecimal."""
    return key.public_key().public_bytes_raw().hex()


def sign(
    key: Ed25519PrivateKey, batch: str | None, meaning: str, who: str, time: str, sha256: str
) -> Signature:
    """Return the signature of a person on a batch record, or on an entry if `batch` is None."""
    unsigned = Signature(batch, meaning, who, time, sha256, public_hex(key))
    return replace(unsigned, signature=key.sign(unsigned.signed()).hex())


def signatures_in(entries: Sequence[Entry], batch: str) -> tuple[Signature, ...]:
    """Return the signatures on a batch in an audit log. Missing values are empty."""
    own = [entry for entry in entries if entry.subject == batch]
    return tuple(each for each in _signatures(own) if each.batch is not None)


def entry_signatures(entries: Sequence[Entry]) -> tuple[Signature, ...]:
    """Return the signatures on entries of an audit log. Missing values are empty."""
    return tuple(each for each in _signatures(entries) if each.batch is None)


def _signatures(entries: Sequence[Entry]) -> Iterator[Signature]:
    for entry in entries:
        if entry.kind == SIGNATURE and isinstance(entry.new, dict):
            values: dict[str, Any] = {
                each.name: str(entry.new.get(each.name, '')) for each in fields(Signature)
            }
            if entry.new.get('batch') is None:
                values['batch'] = None
            yield Signature(**values)


def signature_faults(
    signatures: Sequence[Signature], batch: str | None, sha256: str, persons: int
) -> Iterator[str]:
    """Yield a sentence for each signature that is void.

    `batch` is the name of the signed batch, or None for an entry. `sha256` is the digest of the
    record or of the entry. `persons` is the number of persons who must have signed up to and
    including a signature that releases the record or the entry.
    """
    for number, each in enumerate(signatures, 1):
        what = f'signature {number} ({each.meaning} by {each.who}) is void: '
        if not each.is_genuine:
            yield what + 'it was not made with its key'
        elif each.batch != batch:
            yield what + f'it is on batch {each.batch!r}'
        elif each.sha256 != sha256:
            yield what + 'the record is not the one that was signed'
        elif each.meaning == RELEASE and (lacks := lacking(signatures[:number], persons)):
            yield what + lacks


def foreign_keys(signatures: Sequence[Signature], signers: Mapping[str, Signer]) -> Iterator[str]:
    """Yield a sentence for each signature that the named user has not made or may not make.

    `signers` contains the users by name.
    """
    for number, each in enumerate(signatures, 1):
        signer = signers.get(each.who)
        if signer is None or each.key not in signer.keys:
            yield f'signature {number} was not made with a password of the user {each.who}'
        elif each.meaning == RELEASE and not signer.may_release:
            yield f'signature {number}: the user {each.who} may not release'


def lacking(signatures: Sequence[Signature], persons: int) -> str:
    """Return the reason why signatures do not permit a release, or an empty string if they do.

    A person who has signed twice, or a key with which two persons have signed, counts once.
    """
    names, keys = ({getattr(each, name) for each in signatures} for name in ('who', 'key'))
    count = min(len(names), len(keys))
    return f'{persons} persons must have signed, but only {count} did' if count < persons else ''
