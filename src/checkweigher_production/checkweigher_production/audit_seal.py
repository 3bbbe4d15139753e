# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Seals of an audit log: signed records of its hashes.

Only a person who has noted one of the hashes of a log can detect that the whole log was rewritten.
A seal is such a note. A seal contains the number and the hash of the last entry, the time, and the
hash of the previous seal, and is signed with Ed25519 (RFC 8032). Seals are stored in a separate
file with one line of JSON per seal. Persons with write access to the log must not have access to
the file with the seals or to the signing key.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
import hashlib
import json
from pathlib import Path
from typing import Any

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key

from checkweigher_core.input_files import read_input
from checkweigher_core.state_files import replace_file
from checkweigher_production.audit_log import FIRST_PREVIOUS, AuditError, Entry, Verification


@dataclass(frozen=True, slots=True)
class Seal:
    """Signed record of the number and the hash of the last entry of a log."""

    number: int  # from 1, without gaps
    time: str  # time of the signature, ISO 8601, UTC
    entries: int  # number of sealed entries
    hash: str  # hash of the last sealed entry, hexadecimal, or 64 zeros if the log was empty
    previous: str  # SHA-256 of the previous seal's line, hexadecimal, or 64 zeros for the first
    signature: str = ''  # Ed25519 signature of all other fields, hexadecimal

    def line(self) -> bytes:
        """Return the line of the seal in its file."""
        return json.dumps(asdict(self), separators=(',', ':')).encode('ascii') + b'\n'

    def signed(self) -> bytes:
        """Return the bytes to be signed: the line of the seal with an empty signature."""
        return replace(self, signature='').line()


def seals_path(log: Path) -> Path:
    """Return the default path of the file with the seals of a log."""
    return log.with_name(log.name + '.seals')


def private_key(path: Path) -> Ed25519PrivateKey:
    """Return the signing key in a PEM file.

    Raises `AuditError` if the file cannot be read, is accessible to anyone except its owner, or
    does not contain an Ed25519 private key without a password.
    """
    data = _read(path)
    if path.stat().st_mode & 0o077:
        raise AuditError(f'{path}: others may read this key; chmod 600 it, or make a new one')
    what = 'private key without password; make one: openssl genpkey -algorithm ed25519 -out KEY'
    return _key(path, Ed25519PrivateKey, partial(load_pem_private_key, data, None), what)


def public_key(path: Path) -> Ed25519PublicKey:
    """Return the public key in a PEM file.

    Raises `AuditError` if the file cannot be read or contains no Ed25519 public key.
    """
    what = 'public key; make it of the private one: openssl pkey -in KEY -pubout -out PUBLIC'
    return _key(path, Ed25519PublicKey, partial(load_pem_public_key, _read(path)), what)


def _key(path: Path, kind: type, load: Callable[[], object], what: str) -> Any:
    """Return the key that `load` returns.

    Raises `AuditError` if `load` fails, or if the class of the key is not `kind`.
    """
    try:
        key = load()
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, kind):
        raise AuditError(f'{path}: is not an Ed25519 {what}')
    return key


def read_seals(path: Path, key: Ed25519PublicKey) -> tuple[Seal, ...]:
    """Check the signatures of the seals in a file, and return the seals.

    Raises `AuditError` if the file cannot be read or is empty, if a line is not a seal, or if a
    signature was not made with the private key that belongs to `key`. Raises `AuditError` as well
    if a seal does not follow the seal in the previous line. The removal of the last seals is not
    detected.
    """
    seals: list[Seal] = []
    previous = FIRST_PREVIOUS
    for number, line in enumerate(_read(path).splitlines(keepends=True), 1):
        try:
            seal = Seal(**json.loads(line))
            key.verify(bytes.fromhex(seal.signature), seal.signed())
        except (ValueError, TypeError, RecursionError, InvalidSignature):
            raise AuditError(f'{path}: line {number}: is no seal made with this key') from None
        if (seal.number, seal.previous) != (number, previous) or seal.line() != line:
            raise AuditError(f'{path}: line {number}: does not follow the seal before it')
        previous = hashlib.sha256(line).hexdigest()
        seals.append(seal)
    # The file is created with the first seal in it, so a file without a seal was emptied.
    if not seals:
        raise AuditError(
            f'{path}: there is no seal in it; put it back as it was, or name another file by '
            '--seals'
        )
    return tuple(seals)


def broken_seal(seals: Sequence[Seal], entries: Sequence[Entry]) -> str:
    """Return a message on the first seal that does not fit a log, or '' if all seals fit."""
    for seal in seals:
        begin = f'seal {seal.number} of {seal.time} covers entry {seal.entries}'
        if seal.entries > len(entries):
            return f'{begin}, but the log ends with entry {len(entries)}: its end was removed'
        if _hash_at(entries, seal.entries) != seal.hash:
            return f'{begin}, which is another one now: the log was written again or replaced'
    return ''


def hold_to_seals(
    found: Verification, path: Path, key: Ed25519PublicKey
) -> tuple[tuple[Seal, ...], Verification]:
    """Compare a log with its seals. Returns the seals and the result of verifying the log.

    `found` is the result of verifying the log without its seals, and must state no fault. `path` is
    the file with the seals. If a seal does not fit the log, the returned result has the problem
    'seal' and the reason. If the file cannot be read or contains an invalid seal, the result has
    the problem 'seal' as well, and the returned tuple of seals is empty. Raises `AuditError` if the
    file does not exist.
    """
    if not path.exists():
        raise AuditError(f'{path}: there are no seals; name the file of the seals with --seals')
    try:
        seals = read_seals(path, key)
    except AuditError as error:
        return (), replace(found, problem='seal', reason=str(error))
    broken = broken_seal(seals, found.entries)
    return seals, replace(found, problem='seal' if broken else '', reason=broken)


def sealing(seals: Sequence[Seal], entries: Sequence[Entry]) -> str:
    """Return a text with the number of seals of a log, and the time and entry of the last seal.

    `seals` must contain at least one seal. The text also states the number of entries after the
    last seal.
    """
    last = seals[-1]
    return (
        f'it is the one that was sealed: {last.number} times, the last time at {last.time} through '
        f'entry {last.entries}; entries since then: {len(entries) - last.entries}'
    )


def add_seal(path: Path, log: Path, entries: Sequence[Entry], key: Ed25519PrivateKey) -> Seal:
    """Add a seal of `entries` to the file `path`, sync the file, and return the seal.

    `entries` are all entries of a valid log, and `log` is the path of the log for error messages.
    Raises `AuditError` if the earlier seals cannot be read, were made with another key, or do not
    fit the log, or if the file cannot be written.
    """
    seals = read_seals(path, key.public_key()) if path.exists() else ()
    if broken := broken_seal(seals, entries):
        raise AuditError(f'{log}: {broken}; nothing was sealed')
    seal = Seal(
        number=len(seals) + 1,
        time=datetime.now(UTC).isoformat(timespec='seconds'),
        entries=len(entries),
        hash=_hash_at(entries, len(entries)),
        previous=hashlib.sha256(seals[-1].line()).hexdigest() if seals else FIRST_PREVIOUS,
    )
    seal = replace(seal, signature=key.sign(seal.signed()).hex())
    try:
        # The whole file is replaced, because an incomplete seal would look like a forged seal.
        replace_file(path, (each.line() for each in (*seals, seal)))
    except OSError as error:
        raise AuditError(f'{path}: cannot be written: {error.strerror or error}') from None
    return seal


def _hash_at(entries: Sequence[Entry], number: int) -> str:
    return entries[number - 1].hash if number > 0 else FIRST_PREVIOUS


def _read(path: Path) -> bytes:
    try:
        return read_input(path)
    except OSError as error:
        raise AuditError(f'{path}: cannot be read: {error.strerror or error}') from None
