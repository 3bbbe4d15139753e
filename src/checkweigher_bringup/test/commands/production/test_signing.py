# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command `sign`, and the check of a folder with `audit --all` after forgeries."""

from dataclasses import replace
import hashlib
from io import StringIO
from pathlib import Path
import shutil
import subprocess

from here import run_here
from made_machine import write_machine
import pytest

from checkweigher_production.audit_log import AuditLog, head_path, read_log
from checkweigher_recording.bags.results import mcap_digest
from checkweigher_validation.batch.signatures import entry_signatures, signatures_in
from checkweigher_validation.batch.signing import signable_batch
from checkweigher_web.access.users import (
    Role,
    User,
    hash_password,
    read_users,
    signing_key,
    write_users,
)

PASSWORDS = {'anna': 'correct horse', 'ben': 'battery staple', 'eve': 'one two three'}


@pytest.fixture(scope='module', name='made')
def _made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a batch that two persons have signed, one of whom has released it."""
    folder = tmp_path_factory.mktemp('signed')
    record, _ = write_machine(folder / 'machine')
    roles = {'anna': Role.TECHNICIAN, 'ben': Role.OPERATOR, 'eve': Role.TECHNICIAN}
    hashes = {name: hash_password(name, word) for name, word in PASSWORDS.items()}
    users = {name: User(name, role, hashes[name]) for name, role in roles.items()}
    write_users(folder / 'users', users)
    for who, meaning, password, status, said in (
        ('anna', 'release', '', 1, '2 persons must have signed, but only 1 did'),
        ('ben', 'release', '', 2, 'no user ben with at least the role tech'),
        ('ben', 'review', 'wrong', 1, 'ben: the password is wrong; nothing was signed'),
        ('ben', 'review', '', 0, 'review of batch L1 signed by ben'),
        ('anna', 'release', '', 0, 'release of batch L1 signed by anna'),
    ):
        done = sign(record, who, meaning, folder / 'users', password or PASSWORDS[who])
        assert (done.returncode, said in done.stdout + done.stderr) == (status, True), done.stderr
    write_verification(folder / 'machine')
    sign_entries(folder)
    return folder


def write_verification(machine: Path) -> None:
    """Write a bag, and the audit log entry of the line on the report of its verification."""
    own = machine / 'verifications/v1'
    (own / 'bag').mkdir(parents=True)
    for name in ('bag/line_0.mcap', 'bag/metadata.yaml', 'report.json'):
        (own / name).write_text(name)
    value = {
        'verdict': 'passed',
        'bag': mcap_digest(own / 'bag'),
        'report.json': hashlib.sha256((own / 'report.json').read_bytes()).hexdigest(),
    }
    with AuditLog(machine / 'audit.log') as log:
        log.append('2026-05-28T09:00:00', '/product', 'verification', 'v1', None, value)


def sign_entries(folder: Path) -> None:
    """Sign the verification, and a recipe that two persons must release."""
    machine, users = folder / 'machine', folder / 'users'
    with AuditLog(machine / 'audit.log') as log:
        for number, persons in enumerate((2, 1)):  # one person alone must not lower the number
            time, recipe = f'2026-05-28T10:00:0{number}', {'release_by': persons, 'tare': number}
            last = log.append(time, '/product', 'recipe', 'tins', None, recipe)
    change = '--entry', last.sequence
    for what, who, meaning, status, said in (
        ((machine / 'verifications/v1',), 'ben', 'approval', 0, 'verification v1: passed, 2026'),
        ((machine / 'audit.log', *change), 'anna', 'release', 1, '2 persons must have signed'),
        ((machine / 'audit.log', *change), 'ben', 'review', 0, 'review of recipe tins: - -> 2 v'),
        ((machine / 'audit.log', *change), 'anna', 'release', 0, 'release of recipe tins'),
        ((machine / 'audit.log', '--entry', 1), 'ben', 'review', 1, 'neither a change of limits'),
        ((machine, *change, '--log', machine), 'ben', 'review', 2, 'so leave out --log'),
    ):
        done = sign(what, who, meaning, users, PASSWORDS[who])
        assert (done.returncode, said in done.stdout + done.stderr) == (status, True), done.stderr


@pytest.fixture(name='folder')
def _folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / 'copy'))


def sign(
    what: Path | tuple[object, ...], who: str, meaning: str, users: Path, password: str
) -> subprocess.CompletedProcess[str]:
    given = what if isinstance(what, tuple) else (what,)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('sys.stdin', StringIO(f'{password}\n'))
        return run_here('sign', *given, '--meaning', meaning, '--who', who, '--users', users)


def check(folder: Path) -> tuple[int, str]:
    done = run_here('audit', '--all', folder / 'machine', '--users', folder / 'users')
    assert done.stderr == ''
    return done.returncode, done.stdout


def test_a_signed_batch_has_name_meaning_and_time_and_a_refused_one_is_in_the_log(made: Path):
    status, said = check(made)
    assert (status, said.splitlines()[-1].partition(': ')[2]) == (0, 'all is as it was written')
    record, users = made / 'machine/batches/L1.jsonl', made / 'users'
    done = run_here('batch', record, '--users', users)
    assert done.returncode == 0, done.stdout
    assert 'batch L1: review by ben, 2' in done.stdout
    assert 'batch L1: release by anna, 2' in done.stdout
    refused = [e for e in read_log(made / 'machine/audit.log').entries if e.kind == 'person']
    (attempt,) = refused
    assert (attempt.who, attempt.new) == (
        'claimed:ben',
        'review of batch L1: refused: wrong password',
    )


def test_a_number_that_was_printed_is_shown_again_from_the_record(folder: Path):
    record = folder / 'machine/batches/L1.jsonl'
    done = run_here('batch', record, '--item', 2)
    assert done.returncode == 0, done.stderr
    assert 'line 4: item 2: 100.000 g with packaging\n  ACCEPT, 1970-01-01' in done.stdout
    assert run_here('batch', record, '--item', 3).returncode == 1
    in_folder = run_here('batch', record.parent, '--item', 2)
    assert (in_folder.returncode, in_folder.stdout) == (0, done.stdout)
    assert 'has no item 3' in run_here('batch', record.parent, '--item', 3).stderr
    record.write_bytes(record.read_bytes().replace(b'"mass":0.1,', b'"mass":0.2,'))
    done = run_here('batch', record, '--item', 2)
    assert (done.returncode, '200.000 g' in done.stdout) == (1, True)
    assert 'NOT trusted' in done.stderr


def forge_signature(folder: Path, **values: str | None) -> None:
    """Add a copy of the last signature with other values to the audit log."""
    with AuditLog(folder / 'machine/audit.log') as log:
        forged = replace(signatures_in(log.entries, 'L1')[-1], **values)
        subject = forged.batch or 'entry 1'
        log.append(
            '2026-05-28T08:00:00', 'x', 'signature', subject, None, forged.value, 'claimed:x'
        )


def move_to_another_entry(folder: Path) -> None:
    """Copy the release of the recipe to the entry of the verification."""
    entries = read_log(folder / 'machine/audit.log').entries
    (made,) = (each for each in entries if each.kind == 'verification')
    release = entry_signatures(entries)[-1]
    forge_signature(folder, **release.value | {'batch': None, 'sha256': made.hash})


def sign_as_anna_without_her_password(folder: Path) -> None:
    users = folder / 'own'
    hashed = hash_password('anna', 'my own password')
    write_users(users, {'anna': User('anna', Role.TECHNICIAN, hashed)})
    record = folder / 'machine/batches/L1.jsonl'
    assert sign(record, 'anna', 'approval', users, 'my own password').returncode == 0


def release_as_ben(folder: Path) -> None:
    """Release the batch as an operator, by the functions of the command without its checks."""
    users, what = folder / 'users', signable_batch(folder / 'machine/batches/L1.jsonl')
    key = signing_key(users, read_users(users)['ben'], PASSWORDS['ben'])
    made = what.signature(key, 'release', 'ben', '2026-05-28T08:00:00')
    with AuditLog(folder / 'machine/audit.log') as log:
        log.append('2026-05-28T08:00:00', 'x', 'signature', 'L1', None, made.value, 'x')


def edit(name: str, old: bytes, new: bytes, folder: Path) -> None:
    path = folder / 'machine' / name
    path.write_bytes(path.read_bytes().replace(old, new, 1))


FORGERIES = {
    'report': (
        lambda f: edit('batches/L1.html', b'ACCEPT', b'UNDER', f),
        "report on batch 'L1': L1.html is not as it was",
    ),
    'no report': (
        lambda f: (f / 'machine/batches/L1.json').unlink(),
        "report on batch 'L1': L1.json is missing",
    ),
    'no record': (
        lambda f: (f / 'machine/batches/L1.jsonl').unlink(),
        "batch 'L1': its record is missing",
    ),
    'record': (
        lambda f: edit('batches/L1.jsonl', b'"mass":0.1,', b'"mass":0.2,', f),
        'L1.jsonl: line 3: it or a line before it is not as it was written',
    ),
    'unlisted': (
        lambda f: shutil.copyfile(f / 'machine/batches/L1.jsonl', f / 'machine/batches/L2.jsonl'),
        "L2.jsonl: it is the record of batch 'L1', but has the name of another record",
    ),
    'bag': (
        lambda f: edit('verifications/v1/bag/line_0.mcap', b'l', b'L', f),
        'verification v1: its bag is not as it was',
    ),
    'no bag': (
        lambda f: shutil.rmtree(f / 'machine/verifications/v1/bag'),
        'verification v1: its bag is missing',
    ),
    'unlisted bag': (
        lambda f: shutil.copytree(f / 'machine/verifications/v1', f / 'machine/verifications/v2'),
        'verification v2: the audit log does not know it',
    ),
    'moved signature': (
        lambda f: forge_signature(f, sha256=64 * '0'),
        'L1.jsonl: signature 3 (release by anna) is void: it was not made with its key',
    ),
    'name of another': (
        lambda f: forge_signature(f, who='ben'),
        'L1.jsonl: signature 3 (release by ben) is void: it was not made with its key',
    ),
    'moved to an entry': (
        move_to_another_entry,
        'signature 2 (release by anna) is void: it was not made with its key',
    ),
    'entry that is not there': (
        lambda f: forge_signature(f, batch=None, sha256=64 * '0'),
        'the release by anna is void: the audit log does not have the entry that was signed',
    ),
    'release by an operator': (
        release_as_ben,
        'signature 3: the user ben may not release',
    ),
    'own password': (
        sign_as_anna_without_her_password,
        'L1.jsonl: signature 3 was not made with a password of the user anna',
    ),
}


@pytest.mark.parametrize('name', FORGERIES)
def test_what_was_forged_in_a_folder_is_told(folder: Path, name: str):
    forge, said = FORGERIES[name]
    forge(folder)
    status, told = check(folder)
    assert (status, 'FAULT: ' in told, said in told) == (1, True, True), told


def test_a_folder_without_its_log_or_with_a_spare_one_is_told(folder: Path):
    machine = folder / 'machine'
    with AuditLog(machine / 'spare.log') as spare:
        spare.append('2026-05-28T08:00:00', '/x/product', 'zero', 'zero', 0, 1)
    status, told = check(folder)
    assert (status, 'FAULT: spare.log: no later log names it' in told) == (1, True)
    for path in (machine / 'audit.log', head_path(machine / 'audit.log')):
        path.unlink()
    assert run_here('audit', '--all', machine).returncode == 2
