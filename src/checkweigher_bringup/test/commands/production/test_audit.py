# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""`audit` seals a log, and finds one that is not what was sealed."""

import json
from pathlib import Path

from here import refused, run_here
from sealing import make_keys

from checkweigher_production.audit_log import AuditLog


def write(log: Path, limits: list[int]) -> None:
    with AuditLog(log) as audit:
        for limit in limits:
            audit.append('2026-01-01T00:00:00', '/product', 'parameter', 'reject', None, limit)


def test_a_log_is_sealed_and_checked_by_its_seals(tmp_path: Path):
    log, seals = tmp_path / 'audit.log', tmp_path / 'keys/seals'
    key, public = make_keys(tmp_path / 'keys')
    write(log, [1, 2])
    write(log, [3])

    assert 'there are no seals' in refused('audit', log, '--trust', public, '--seals', seals)
    done = run_here('audit', log, '--seal', key, '--seals', seals)
    assert (done.returncode, done.stderr) == (0, 'sealed: seal 1, through entry 3\n')
    write(log, [4])
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
    assert 'lies in the folder of the log' in done.stderr


def test_no_text_of_a_log_reaches_the_terminal_as_it_is(tmp_path: Path):
    log = tmp_path / 'audit.log'
    with AuditLog(log) as audit:
        audit.append('\x1b[1m', '/product', '\x1b[2m', '\x1b[3m\n', '\x1b[4m', '\x1b[5m', '\x1b[6m')
    done = run_here('audit', log)
    assert done.returncode == 0, done.stderr
    assert '\x1b' not in done.stdout
    assert len(done.stdout.splitlines()) == 3
