# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Campaigns on the audit log, each with its counts: tampering, kills, and disks that are full."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
import random
import subprocess
import sys
import time

from full_disk import file_size_limit
import pytest

from checkweigher_production.audit_log import (
    FIRST_PREVIOUS,
    AuditError,
    AuditLog,
    Entry,
    head_path,
    read_log,
    verify,
)

TIME = '2026-01-01T00:00:00.000000Z'
ENTRIES = 12
WRITER = """
import sys
from pathlib import Path
from checkweigher_production.audit_log import AuditLog
with AuditLog(Path(sys.argv[1])) as log:
    number = int(sys.argv[2])
    while True:
        log.append('now', '/product', 'parameter', '/reject.lower_limit', None, number)
        print(number, flush=True)
        number += 1
"""
soak = pytest.mark.soak


def append(log: AuditLog, number: int) -> None:
    log.append(TIME, '/product', 'parameter', '/reject.lower_limit', None, number)


def chained(entries: list[Entry]) -> bytes:
    """Return the lines of entries with hashes that fit."""
    lines, previous = [], FIRST_PREVIOUS
    for number, entry in enumerate(entries, 1):
        new = replace(entry, sequence=number, previous=previous)
        new = replace(new, hash=new.digest())
        lines.append(new.line())
        previous = new.hash
    return b''.join(lines)


def tamperings(data: bytes, head: bytes, step: int) -> Iterator[tuple[str, bytes, bytes]]:
    """Yield log and head after each tampering, with its name."""
    for at in range(0, len(data), step):
        for bit in (1, 32):
            flipped = bytes([data[at] ^ bit])
            yield 'byte', data[:at] + flipped + data[at + 1 :], head
        yield 'truncated', data[:at], head
        yield 'byte removed', data[:at] + data[at + 1 :], head
    for at in range(len(head)):
        yield 'head', data, head[:at] + bytes([head[at] ^ 1]) + head[at + 1 :]
        yield 'head', data, head[:at]
    lines = data.splitlines(keepends=True)
    for at in range(ENTRIES):
        yield 'line removed', b''.join(lines[:at] + lines[at + 1 :]), head
        yield 'line doubled', b''.join(lines[: at + 1] + lines[at:]), head
        yield 'head removed', b''.join(lines[:at]), b''
        for other in range(at):
            swapped = list(lines)
            swapped[at], swapped[other] = lines[other], lines[at]
            yield 'lines swapped', b''.join(swapped), head
    entries = list(verify(data, head).entries)
    for at in range(ENTRIES):
        forged = [*entries]
        forged[at] = replace(forged[at], new=99)
        yield 'chained again', chained(forged), head
        yield 'prefix chained again', chained(forged[: at + 1]), head
        yield 'prefix chained again', chained(forged[: at + 1]) + b''.join(lines[at + 1 :]), head
        yield 'chained without a line', chained(entries[:at] + entries[at + 1 :]), head


@pytest.mark.parametrize('step', [23, pytest.param(3, marks=soak)])
def test_each_tampering_is_told(tmp_path: Path, step: int):
    path = tmp_path / 'audit.log'
    with AuditLog(path) as log:
        for number in range(ENTRIES):
            append(log, number)
    data, head = path.read_bytes(), head_path(path).read_bytes()
    tried, escaped = 0, []
    for name, text, knows in tamperings(data, head, step):
        tried += 1
        if verify(text, knows).whole:
            escaped.append((name, text, knows))
    print(f'tampered {tried} times, told {tried - len(escaped)}, escaped {len(escaped)}')
    assert [name for name, _, _ in escaped] == []


@pytest.mark.parametrize('kills', [5, pytest.param(300, marks=soak)])
def test_no_entry_that_was_acknowledged_is_lost_or_doubled_by_a_kill(tmp_path: Path, kills: int):
    path, chance = tmp_path / 'audit.log', random.Random(kills)
    acknowledged: list[int] = []
    number = torn = 0
    for _ in range(kills):
        with subprocess.Popen(
            [sys.executable, '-c', WRITER, str(path), str(number)], stdout=subprocess.PIPE
        ) as writer:
            told = [writer.stdout.readline()]
            time.sleep(chance.uniform(0, 0.05))
            writer.kill()
            told += writer.stdout.readlines()
        acknowledged += [int(line) for line in told if line.endswith(b'\n')]
        found = read_log(path)
        assert found.whole, found.reason
        torn += bool(found.torn)
        number = max(entry.new for entry in found.entries if entry.kind == 'parameter') + 1
    written = [entry.new for entry in read_log(path).entries if entry.kind == 'parameter']
    lost, doubled = set(acknowledged) - set(written), len(written) - len(set(written))
    print(
        f'killed {kills} times; {len(acknowledged)} entries acknowledged, lost {len(lost)}, '
        f'doubled {doubled}, written and not acknowledged {len(written) - len(acknowledged)}, '
        f'torn {torn}; files left {sorted(each.name for each in tmp_path.iterdir())}'
    )
    assert (lost, doubled) == (set(), 0)
    assert {each.name for each in tmp_path.iterdir()} <= {
        'audit.log', 'audit.log.head', 'audit.log.head.next'
    }  # fmt: skip


@pytest.mark.parametrize('rounds', [20, pytest.param(300, marks=soak)])
def test_what_is_refused_on_a_full_disk_is_no_entry_and_what_is_taken_is_one(
    tmp_path: Path, rounds: int
):
    path, chance = tmp_path / 'audit.log', random.Random(rounds)
    taken, refused = [], []
    number = 0
    for _ in range(rounds):
        with AuditLog(path) as log:
            for _ in range(chance.randint(1, 3)):
                with file_size_limit(
                    log.size + chance.choice([0, 1, 250, 400, 700, *range(270, 300)])
                ):
                    number += 1
                    try:
                        append(log, number)
                        taken.append(number)
                    except AuditError:
                        refused.append(number)
            assert read_log(path).whole
    with AuditLog(path) as log:
        append(log, number + 1)
    taken.append(number + 1)
    found = read_log(path)
    assert found.whole, found.reason
    written = [entry.new for entry in found.entries if entry.kind == 'parameter']
    lost, false = set(taken) - set(written), set(refused) & set(written)
    doubled = len(written) - len(set(written))
    print(
        f'{len(taken)} entries taken, lost {len(lost)}, doubled {doubled}; {len(refused)} refused, '
        f'of these in the log {len(false)}'
    )
    assert (lost, doubled, false) == (set(), 0, set())
