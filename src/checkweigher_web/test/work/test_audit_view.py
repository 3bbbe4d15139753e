# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Audit log on the page, compared with the command `audit`."""

from collections.abc import Callable
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
import pytest
from running import run_command

from checkweigher_production.audit_log import AuditError, AuditLog, head_path, read_log
from checkweigher_production.audit_seal import add_seal, seals_path
from checkweigher_web.work.audit_view import NEWEST, view_of

KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
PUBLIC = KEY.public_key()


def write(log: Path, count: int) -> None:
    with AuditLog(log) as audit:
        for number in range(count):
            time = f'2026-05-28T06:00:{number % 60:02}.000000+00:00'
            subject = '/lane1/reject.lower_limit'
            change = None if number == 0 else 0.14, 0.15 + number
            audit.append(time, '/lane1/product', 'parameter', subject, *change, 'ann', f'R{number}')


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return an audit log with three entries."""
    write(tmp_path / 'audit.log', 3)
    return tmp_path / 'audit.log'


def said(log: Path) -> str:
    return str(run_command('audit', log).stdout.splitlines()[-1])


def test_the_latest_entry_comes_first_with_who_what_and_why(log: Path):
    view = view_of(log, None)
    assert (view.whole, view.conclusion) == (True, said(log))
    assert view.count == '3 entries'
    what = '/lane1/reject.lower_limit: '
    assert view.rows[0] == (
        '3', '2026-05-28 06:00:02', 'ann', 'parameter', f'{what}0.14 → 2.15', 'R2'
    )  # fmt: skip
    assert view.rows[2][4] == f'{what}0.15'  # there was no value before


def test_many_changes_of_an_entry_are_lines_up_to_a_number(tmp_path: Path):
    log = tmp_path / 'audit.log'
    old, new = ({f'p{n}': n + more for n in range(30)} for more in (0, 1))
    with AuditLog(log) as audit:
        audit.append('2026-05-28T06:00:00', '/product', 'found', '/reject', old, new)
    lines = view_of(log, None).rows[0][4].splitlines()
    assert lines[:2] == ['/reject.p0: 0 → 1', '/reject.p1: 1 → 2']
    assert (len(lines), lines[-1]) == (21, 'and 10 more')


def test_of_many_entries_the_newest_are_shown(tmp_path: Path):
    write(tmp_path / 'audit.log', NEWEST + 5)
    view = view_of(tmp_path / 'audit.log', None)
    assert view.count == f'{NEWEST + 5} entries; the newest {NEWEST} are shown'
    assert [row[0] for row in view.rows[:: NEWEST - 1]] == [str(NEWEST + 5), '6']


@pytest.mark.parametrize(
    ('wanted', 'numbers'),
    [
        ('r1', ['2']),  # a reason
        (' ANN ', ['3', '2', '1']),  # a person
        ('lane1/product', ['3', '2', '1']),  # the node that wrote the entry
        ('2.15', ['3']),  # a value
        ('nobody', []),
    ],
)
def test_a_filter_leaves_the_entries_with_its_text(log: Path, wanted: str, numbers: list[str]):
    view = view_of(log, None, wanted)
    assert [row[0] for row in view.rows] == numbers
    assert view.count == f'3 entries, {len(numbers)} of them with {wanted.strip()!r}'


@pytest.mark.parametrize(
    ('tamper', 'begin', 'rows'),
    [
        (lambda text: text.replace(b'"new":1.15', b'"new":1.16'), 'line 2: changed: ', 1),
        (lambda text: b''.join(text.splitlines(keepends=True)[:2]), 'line 3: cut: ', 2),
    ],
)
def test_a_broken_log_is_told_as_by_the_command(
    log: Path, tamper: Callable[[bytes], bytes], begin: str, rows: int
):
    log.write_bytes(tamper(log.read_bytes()))
    view = view_of(log, PUBLIC)
    assert view.conclusion.startswith(f'BROKEN: {begin}')
    assert (view.whole, view.conclusion, view.seals) == (False, said(log), '')
    assert (len(view.rows), view.count) == (rows, f'{rows} entries before line {rows + 1}')


def test_a_log_that_is_not_there_is_an_error(tmp_path: Path):
    with pytest.raises(AuditError, match='No such file'):
        view_of(tmp_path / 'audit.log', None)


def test_seals_hold_or_the_log_is_broken(log: Path):
    add_seal(seals_path(log), log, read_log(log).entries, KEY)
    write(log, 2)
    view = view_of(log, PUBLIC)
    assert (view.whole, view.seals_hold) == (True, True)
    assert view.seals.endswith('through entry 3; entries since then: 2')

    kept = seals_path(log).read_bytes()
    log.unlink()
    head_path(log).unlink()
    write(log, 2)
    view = view_of(log, PUBLIC)
    assert (view.whole, view.seals_hold, view.seals) == (False, False, '')
    assert view.conclusion.startswith('BROKEN: seal 1 of ')
    assert len(view.rows) == 2

    seals_path(log).write_bytes(b'')
    assert 'there is no seal in it' in view_of(log, PUBLIC).conclusion
    seals_path(log).write_bytes(kept)
    other = Ed25519PrivateKey.generate().public_key()
    assert 'is no seal made with this key' in view_of(log, other).conclusion


@pytest.mark.parametrize(
    ('sealed', 'key', 'hold', 'text', 'more'),
    [
        (False, None, None, 'There are no seals in ', ' --seals FILE'),
        (False, PUBLIC, False, 'There are no seals in ', ' --seals FILE'),
        (True, None, None, ', and the page has no public key ', ''),
    ],
)
def test_a_log_without_seals_or_key_is_told_with_the_command(log, sealed, key, hold, text, more):
    if sealed:
        add_seal(seals_path(log), log, read_log(log).entries, KEY)
    view = view_of(log, key)
    assert (view.whole, view.seals_hold) == (True, hold)
    assert text in view.seals
    assert str(seals_path(log)) in view.seals
    assert view.seals.endswith(f'run ./checkweigher audit {log} --trust PUBLIC{more}')
