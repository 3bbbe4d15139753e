# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Seals show what the chain alone cannot: a log that was cut, replaced or chained again."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import subprocess

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
import pytest

from checkweigher_production.audit_log import (
    FIRST_PREVIOUS,
    AuditError,
    AuditLog,
    Entry,
    head_path,
    read_log,
)
from checkweigher_production.audit_seal import (
    Seal,
    add_seal,
    broken_seal,
    private_key,
    public_key,
    read_seals,
)

KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))


def write(log: Path, limits: Sequence[float]) -> tuple[Entry, ...]:
    with AuditLog(log) as audit:
        for limit in limits:
            audit.append('2026-01-01T00:00:00', '/product', 'parameter', 'reject', 0.1, limit)
    return read_log(log).entries


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return a log of five entries, sealed after the third and after the fifth."""
    path = tmp_path / 'line' / 'audit.log'
    path.parent.mkdir()
    add_seal(tmp_path / 'seals', path, write(path, [1, 2, 3]), KEY)
    add_seal(tmp_path / 'seals', path, write(path, [4, 5]), KEY)
    return path


def test_a_log_that_goes_on_keeps_its_seals(log: Path, tmp_path: Path):
    write(log, [6])
    seals = read_seals(tmp_path / 'seals', KEY.public_key())
    assert [(seal.number, seal.entries) for seal in seals] == [(1, 3), (2, 5)]
    assert not broken_seal(seals, read_log(log).entries)


def chained_again(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Change the second entry, and forge every hash from there on."""
    changed: list[Entry] = []
    for entry in entries:
        new = 99 if entry.sequence == 2 else entry.new
        previous = changed[-1].hash if changed else FIRST_PREVIOUS
        entry = replace(entry, new=new, previous=previous)
        changed.append(replace(entry, hash=entry.digest()))
    return tuple(changed)


def test_what_was_forged_with_its_head_is_found(log: Path, tmp_path: Path):
    seals = read_seals(tmp_path / 'seals', KEY.public_key())
    entries = read_log(log).entries
    assert 'its end was removed' in broken_seal(seals, entries[:4])
    for forged in (chained_again(entries), write(tmp_path / 'other.log', [1, 2, 3, 4, 6])):
        assert 'written again or replaced' in broken_seal(seals, forged)
    log.unlink()
    head_path(log).unlink()
    with pytest.raises(AuditError, match='nothing was sealed'):
        add_seal(tmp_path / 'seals', log, write(log, [1, 2, 3]), KEY)


def with_other_key(lines: list[bytes]) -> list[bytes]:
    seal = Seal(2, '2026-01-01T00:00:00+00:00', 5, 'a' * 64, 'b' * 64)
    signature = Ed25519PrivateKey.generate().sign(seal.signed()).hex()
    return [lines[0], replace(seal, signature=signature).line()]


@pytest.mark.parametrize(
    'forge',
    [
        lambda lines: lines[1:],
        lambda lines: lines[::-1],
        lambda lines: [lines[0], lines[1].replace(b'"entries":5', b'"entries":4')],
        lambda lines: [b'[' * 100_000 + b'\n', *lines[1:]],
        with_other_key,
    ],
)
def test_seals_that_were_tampered_with_are_refused(log: Path, tmp_path: Path, forge):
    path = tmp_path / 'seals'
    path.write_bytes(b''.join(forge(path.read_bytes().splitlines(keepends=True))))
    with pytest.raises(AuditError, match=r'seals: line [12]: '):
        read_seals(path, KEY.public_key())


def test_an_empty_file_is_told_and_not_begun_anew(log: Path, tmp_path: Path):
    path = tmp_path / 'seals'
    path.write_bytes(b'')
    with pytest.raises(AuditError, match='seals: there is no seal in it; put it back'):
        read_seals(path, KEY.public_key())
    with pytest.raises(AuditError, match='there is no seal in it') as refused:
        add_seal(path, log, read_log(log).entries, KEY)
    assert len(str(refused.value).splitlines()) == 1
    assert path.read_bytes() == b''


def test_keys_are_those_of_openssl_and_others_are_refused(tmp_path: Path):
    key, public = tmp_path / 'key.pem', tmp_path / 'public.pem'
    subprocess.run(['openssl', 'genpkey', '-algorithm', 'ed25519', '-out', key], check=True)
    subprocess.run(['openssl', 'pkey', '-in', key, '-pubout', '-out', public], check=True)
    key.chmod(0o600)
    signature = private_key(key).sign(b'text')
    public_key(public).verify(signature, b'text')
    key.chmod(0o644)
    with pytest.raises(AuditError, match='chmod 600'):
        private_key(key)
    with pytest.raises(AuditError, match='is not an Ed25519 public key'):
        public_key(key)
    with pytest.raises(AuditError, match=r'nothing: cannot be read: No such file'):
        public_key(tmp_path / 'nothing')
