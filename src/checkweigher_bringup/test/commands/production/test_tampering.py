# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command `audit`, which seals a log and finds each kind of tampering (docs/records.md)."""

from collections.abc import Callable
import json
from pathlib import Path
import shutil
import subprocess
import sys

from here import refused, run_here
import pytest
from running import ROOT
from sealing import make_keys

from checkweigher_production.audit_log import AuditLog, head_path

Forge = Callable[[Path], object]


def write(log: Path, *limits: float) -> None:
    with AuditLog(log) as audit:
        for number, limit in enumerate(limits):
            time = f'2026-05-28T06:00:0{number}.000000+00:00'
            subject = '/lane1/reject.lower_limit'
            audit.append(time, '/lane1/product', 'parameter', subject, None, limit, 'ann', 'order')


def lines(log: Path) -> list[bytes]:
    return log.read_bytes().splitlines(keepends=True)


def chained_again(log: Path, *limits: float) -> None:
    log.unlink()
    head_path(log).unlink()
    write(log, *limits)


def replaced(old: bytes, new: bytes) -> Forge:
    return lambda log: log.write_bytes(log.read_bytes().replace(old, new, 1))


def reordered(*order: int) -> Forge:
    """Return a function that keeps only the lines with these numbers, in this order."""
    return lambda log: log.write_bytes(b''.join(lines(log)[number] for number in order))


def tail_with_head(log: Path) -> None:
    chained_again(log, 0.14, 0.15, 0.16)  # the same bytes as those of the first three entries


def whole_file(log: Path) -> None:
    chained_again(log, 0.13, 0.13, 0.13, 0.13)


def from_one_entry_on(log: Path) -> None:
    chained_again(log, 0.14, 0.13, 0.16, 0.17)


def emptied_seals(log: Path) -> None:
    whole_file(log)
    (log.parent / 'keys/seals').write_bytes(b'')


# Way, and what `audit` says: without, and with the seal of a key that the forger does not have.
WAYS: list[tuple[str, Forge, str, str]] = [
    ('a value is changed', replaced(b'"new":0.14', b'"new":0.13'), 'line 1: changed', ''),
    ('the person is changed', replaced(b'"ann"', b'"bob"'), 'line 1: changed', ''),
    ('a line in the middle is removed', reordered(0, 2, 3), 'line 2: removed', ''),
    ('two lines are exchanged', reordered(0, 2, 1, 3), 'line 2: removed', ''),
    ('a line is added', reordered(0, 1, 2, 3, 1), 'line 5: inserted', ''),
    ('the last line is removed', reordered(0, 1, 2), 'line 4: cut', ''),
    ('LOG.head is removed', lambda log: head_path(log).unlink(), 'line 5: cut', ''),
    ('the last line is removed, with its head', tail_with_head, '', 'its end was removed'),
    ('log and head are those of another log', whole_file, '', 'was written again or replaced'),
    (
        'an entry is changed, all behind it chained again',
        from_one_entry_on,
        '',
        'was written again or replaced',
    ),
    ('the same, and the seals are emptied', emptied_seals, '', 'there is no seal in it'),
]


@pytest.fixture(scope='module', name='sealed')
def _sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('sealed')
    key, _ = make_keys(folder / 'keys')
    write(folder / 'audit.log', 0.14, 0.15, 0.16, 0.17)
    done = run_here('audit', folder / 'audit.log', '--seal', key, '--seals', folder / 'keys/seals')
    assert done.returncode == 0, done.stderr
    return folder


def audit(folder: Path, *, trust: bool) -> tuple[int, str]:
    keys = folder / 'keys'
    options = ['--trust', keys / 'public', '--seals', keys / 'seals'] if trust else []
    done = run_here('audit', folder / 'audit.log', *options)
    return done.returncode, done.stdout.splitlines()[-1]


@pytest.mark.parametrize(('way', 'forge', 'alone', 'by_seal'), WAYS, ids=[w[0] for w in WAYS])
def test_each_way_is_told(
    sealed: Path, tmp_path: Path, way: str, forge: Forge, alone: str, by_seal: str
):
    folder = tmp_path / 'copy'
    shutil.copytree(sealed, folder)
    assert audit(folder, trust=True)[0] == 0
    forge(folder / 'audit.log')

    status, said = audit(folder, trust=False)
    print(f'{way}: {said}')
    assert (status, alone in said) == (1 if alone else 0, True)
    status, said = audit(folder, trust=True)
    print(f'{way}: --trust: {said}')
    assert status == 1
    assert (by_seal or alone) in said


@pytest.mark.parametrize('noted', ['', ' ', '1234', 'g' * 64])
def test_a_noted_hash_that_is_none_is_refused(sealed: Path, noted: str):
    assert 'is not the hash of an entry' in refused('audit', sealed / 'audit.log', '--hash', noted)


def test_a_second_writer_is_refused_and_costs_no_entry(tmp_path: Path):
    """Check that a second writer is refused, and that the first one continues unaffected."""
    log = tmp_path / 'audit.log'
    write(log, 0.14)
    program = (
        'import sys; from pathlib import Path; '
        'from checkweigher_production.audit_log import AuditLog; '
        'AuditLog(Path(sys.argv[1]))'
    )
    with AuditLog(log) as first:
        second = subprocess.run(
            [sys.executable, '-c', program, log], capture_output=True, text=True, cwd=ROOT
        )
        assert 'another process writes to this log' in second.stderr
        first.append('2026-05-28T06:00:09+00:00', '/lane1/product', 'zero', 'zero', None, 1.0)
    done = run_here('audit', log)
    assert (done.returncode, 'the chain is whole: 2 entries' in done.stdout) == (0, True)


def test_a_log_that_is_piped_has_each_value_in_full(tmp_path: Path):
    log, limit = tmp_path / 'audit.log', list(range(100))
    with AuditLog(log) as audit:
        audit.append('2026-05-28T06:00:00+00:00', '/reject', 'parameter', 'limits', None, limit)
    assert str(limit) in run_here('audit', log).stdout


def test_a_log_is_sealed_and_checked_by_its_seals(tmp_path: Path):
    log, seals = tmp_path / 'audit.log', tmp_path / 'keys/seals'
    key, public = make_keys(tmp_path / 'keys')
    write(log, 1, 2)
    write(log, 3)

    assert 'there are no seals' in refused('audit', log, '--trust', public, '--seals', seals)
    done = run_here('audit', log, '--seal', key, '--seals', seals)
    assert (done.returncode, done.stderr) == (0, 'sealed: seal 1, through entry 3\n')
    write(log, 4)
    done = run_here('audit', log, '--trust', public, '--seals', seals, '--json')
    assert done.returncode == 0, done.stderr
    assert [seal['entries'] for seal in json.loads(done.stdout)['seals']] == [3]

    kept = seals.read_bytes()
    seals.write_bytes(b'')
    done = run_here('audit', log, '--seal', key, '--seals', seals)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert f'{seals}: there is no seal in it; put it back as it was' in line
    assert seals.read_bytes() == b''
    seals.write_bytes(kept)

    beside = log.with_name('key')
    beside.write_bytes(key.read_bytes())
    done = run_here('audit', log, '--seal', beside, '--seals', seals)
    assert done.returncode == 2
    assert 'the key is in the folder of the log' in done.stderr


def test_no_text_of_a_log_reaches_the_terminal_as_it_is(tmp_path: Path):
    log = tmp_path / 'audit.log'
    with AuditLog(log) as audit:
        audit.append('\x1b[1m', '/product', '\x1b[2m', '\x1b[3m\n', '\x1b[4m', '\x1b[5m', '\x1b[6m')
    done = run_here('audit', log)
    assert done.returncode == 0, done.stderr
    assert '\x1b' not in done.stdout
    assert len(done.stdout.splitlines()) == 3
