# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Electronic signatures on the records of batches (21 CFR 11.50 and 11.70).

A signature is an entry of the audit log. It contains the name of the person, the time, the meaning
and the SHA-256 of the record, and is signed with an Ed25519 key that is derived from the password
of the person. It is void for any other record, and for the same record after a change.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
import json
from typing import Any

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from checkweigher_core.changes import SIGNATURE
from checkweigher_production.audit_log import Entry

REVIEW, APPROVAL, RELEASE = 'review', 'approval', 'release'
MEANINGS = REVIEW, APPROVAL, RELEASE


@dataclass(frozen=True, slots=True)
class Signature:
    """Signature of a person on the record of a batch."""

    batch: str
    meaning: str  # one of MEANINGS
    who: str  # name of the person
    time: str  # ISO 8601, UTC
    sha256: str  # SHA-256 of the record, hexadecimal
    key: str  # Ed25519 public key, hexadecimal
    signature: str = ''  # Ed25519 signature of all other fields, hexadecimal

    def signed(self) -> bytes:
        """Return the bytes to be signed."""
        return json.dumps(asdict(replace(self, signature='')), separators=(',', ':')).encode()

    @property
    def is_genuine(self) -> bool:
        """Whether the signature was made with its key."""
        try:
            key = Ed25519PublicKey.from_public_bytes(bytes.fromhex(self.key))
            key.verify(bytes.fromhex(self.signature), self.signed())
        except (ValueError, InvalidSignature):
            return False
        return True


def public_hex(key: Ed25519PrivateKey) -> str:
    """Return the public key of a private key, hexadecimal."""
    return key.public_key().public_bytes_raw().hex()


def sign(
    key: Ed25519PrivateKey, batch: str, meaning: str, who: str, time: str, sha256: str
) -> Signature:
    """Return the signature of a person on the record of a batch."""
    unsigned = Signature(batch, meaning, who, time, sha256, public_hex(key))
    return replace(unsigned, signature=key.sign(unsigned.signed()).hex())


def signatures_in(entries: Sequence[Entry], batch: str) -> tuple[Signature, ...]:
    """Return the signatures on a batch in an audit log. Missing values are empty."""
    return tuple(
        _of(entry.new)
        for entry in entries
        if (entry.kind, entry.subject) == (SIGNATURE, batch) and isinstance(entry.new, dict)
    )


def _of(value: dict[str, Any]) -> Signature:
    return Signature(**{each.name: str(value.get(each.name, '')) for each in fields(Signature)})


def signature_faults(
    signatures: Sequence[Signature], batch: str, sha256: str, persons: int
) -> Iterator[str]:
    """Yield a sentence for each signature that is void.

    `persons` is the number of persons who must have signed when a batch is released.
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


def foreign_keys(signatures: Sequence[Signature], keys: Mapping[str, str]) -> Iterator[str]:
    """Yield a sentence for each signature that was not made with the password of its person.

    `keys` contains the public keys of each user, separated by spaces.
    """
    for number, each in enumerate(signatures, 1):
        if each.key not in keys.get(each.who, '').split():
            yield f'signature {number} was not made with a password of the user {each.who}'


def lacking(signatures: Sequence[Signature], persons: int) -> str:
    """Return why a batch with these signatures may not be released, or an empty text."""
    names, keys = ({getattr(each, name) for each in signatures} for name in ('who', 'key'))
    count = min(len(names), len(keys))
    return f'{persons} persons must have signed, but only {count} did' if count < persons else ''
