# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The audit log: each tampering is found, a power loss is told apart from it, and campaigns."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
import hashlib
import json
import math
import os
from pathlib import Path
import random
import shutil
import subprocess
import sys
import threading
import time

from full_disk import file_size_limit
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from checkweigher_production.audit_chain import name_predecessor, read_chain
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


def write(path: Path, count: int) -> None:
    with AuditLog(path) as log:
        for number in range(count):
            log.append(TIME, '/product', 'parameter', f'/reject.limit{number}', number, -math.inf)


def write_behind_the_head(path: Path) -> int:
    """Write an entry that the head does not know; return the size of the log before it."""
    head, size = head_path(path).read_bytes(), path.stat().st_size
    write(path, 1)
    head_path(path).write_bytes(head)
    return size


@pytest.fixture(name='path')
def _path(tmp_path: Path) -> Path:
    return tmp_path / 'audit.log'


@pytest.fixture(scope='module', name='log')
def _log(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, bytes]:
    """Return a log of five entries and its head."""
    path = tmp_path_factory.mktemp('audit') / 'audit.log'
    write(path, 5)
    return path.read_bytes(), head_path(path).read_bytes()


def test_what_was_written_is_read_back(path: Path):
    with AuditLog(path) as log:
        log.append(TIME, '/product', 'parameter', '/reject.upper_limit', math.inf, 0.16)
        new = {'length': (0.1, 0.2)}
        log.append(TIME, '/product', 'recipe', 'crisps', None, new, 'ann', 'order 7')
    found = read_log(path)
    assert found.whole
    assert [(e.sequence, e.kind, e.old, e.new, e.who, e.why) for e in found.entries] == [
        (1, 'parameter', 'inf', 0.16, 'graph:/product', ''),
        (2, 'recipe', None, {'length': [0.1, 0.2]}, 'ann', 'order 7'),
    ]


def test_the_hash_is_the_sha256_of_the_previous_hash_and_the_entry(log: tuple[bytes, bytes]):
    first, second = log[0].splitlines()[:2]
    text, _, rest = second.rpartition(b',"hash":"')
    assert rest == hashlib.sha256(text + b'}').hexdigest().encode() + b'"}'
    assert json.loads(second)['previous'] == json.loads(first)['hash']


def test_a_log_of_a_version_that_knew_no_author_is_whole_and_goes_on(path: Path):
    older = Entry(1, TIME, '/product', 'parameter', '/reject.limit0', 0, 'inf', FIRST_PREVIOUS)
    older = replace(older, hash=older.digest())
    assert b'who' not in older.line()
    path.write_bytes(older.line())
    head_path(path).write_text(f'{{"sequence":1,"hash":"{older.hash}"}}\n')

    write(path, 1)

    found = read_log(path)
    assert found.whole
    assert [(entry.sequence, entry.who) for entry in found.entries] == [
        (1, None),
        (2, 'graph:/product'),
    ]


@settings(max_examples=500)
@given(st.data())
def test_any_change_of_a_single_byte_is_found_in_its_line(log: tuple[bytes, bytes], data):
    text, head = log
    position = data.draw(st.integers(0, len(text) - 1))
    value = data.draw(st.integers(0, 255).filter(lambda v: v != text[position]))
    changed = text[:position] + bytes([value]) + text[position + 1 :]
    found = verify(changed, head)
    assert not found.whole
    line = text[:position].count(b'\n') + 1
    # The end of the last line is missed by the head: the line is then no longer there.
    assert found.bad_line == line


@pytest.mark.parametrize('number', range(5))
def test_a_line_that_was_removed_is_missed(log: tuple[bytes, bytes], number: int):
    lines = log[0].splitlines(keepends=True)
    del lines[number]
    found = verify(b''.join(lines), log[1])
    assert found.problem == ('cut' if number == 4 else 'removed')
    assert found.bad_line == number + 1


@pytest.mark.parametrize('copied', range(5))
@pytest.mark.parametrize('place', range(6))
def test_a_line_that_was_inserted_is_found(log: tuple[bytes, bytes], copied: int, place: int):
    lines = log[0].splitlines(keepends=True)
    lines.insert(place, lines[copied])
    found = verify(b''.join(lines), log[1])
    # A line put before its like: it is the second of the two that is one too many.
    expected = place + 1 if place != copied else place + 2
    assert found.bad_line == expected
    assert found.problem == ('removed' if place < copied else 'inserted')


def test_entries_written_behind_the_back_of_the_head_are_found(path: Path):
    write(path, 3)
    head = head_path(path).read_bytes()
    write(path, 2)
    assert verify(path.read_bytes(), head).problem == 'inserted'


def test_a_log_rewritten_from_the_start_is_found_by_a_hash_noted_elsewhere(
    path: Path, tmp_path: Path
):
    forged = tmp_path / 'forged.log'
    write(path, 3)
    noted = read_log(path).entries[1].hash
    write(forged, 1)
    assert read_log(forged).whole
    assert read_log(path, noted).whole
    assert read_log(forged, noted).problem == 'cut'


@settings(max_examples=15, deadline=None)
@given(kept=st.integers(1, 289))
def test_an_entry_torn_by_power_loss_is_no_tampering(
    tmp_path_factory: pytest.TempPathFactory, kept: int
):
    path = tmp_path_factory.mktemp('torn') / 'audit.log'
    write(path, 2)
    size = write_behind_the_head(path)
    os.truncate(path, size + kept)
    found = read_log(path)
    assert found.whole
    assert len(found.torn) == kept
    # Going on, the log says what had been torn, and that is part of the chain.
    write(path, 1)
    found = read_log(path)
    assert found.whole
    assert ' '.join(entry.kind for entry in found.entries) == 'parameter parameter torn parameter'
    data, head = path.read_bytes(), head_path(path).read_bytes()
    changed = data[:size] + b'X' + data[size + 1 :]
    assert verify(changed, head).bad_line == 3
    removed = data[:size] + data[size + kept + 1 :]
    assert verify(removed, head).problem == 'removed'


def test_an_entry_that_lacks_its_end_of_line_alone_is_kept(path: Path):
    write(path, 1)
    write_behind_the_head(path)
    path.write_bytes(path.read_bytes()[:-1])
    for entries in (2, 3, 4):  # it goes on, and is read again
        found = read_log(path)
        assert (found.whole, found.torn, len(found.entries)) == (True, b'', entries)
        write(path, 1)


@pytest.mark.parametrize('kept', [-1, -20])
def test_what_the_head_knows_was_not_torn_by_power_loss(log: tuple[bytes, bytes], kept: int):
    found = verify(log[0][:kept], log[1])
    assert (found.problem, found.bad_line) == ('cut', 5)
    assert verify(log[0] + bytes(100), log[1]).whole  # zeros, as some file systems leave them
    for garbage in (b'{', b'{"sequence":6,"time":"2026'):
        assert verify(log[0] + garbage, log[1]).torn == garbage
    for garbage in (b'xyz', b'{"sequence":7,', b'{"sequence":6,\n', b'{"sequence":6,\xff'):
        found = verify(log[0] + garbage, log[1])
        assert (found.problem, found.bad_line) == ('changed', 6)


def test_power_lost_between_an_entry_and_its_head_does_no_harm(path: Path):
    write(path, 1)
    write_behind_the_head(path)
    assert read_log(path).whole
    write(path, 1)
    assert len(read_log(path).entries) == 3


def test_a_broken_log_is_not_continued(path: Path):
    write(path, 3)
    path.write_bytes(path.read_bytes().replace(b'limit1', b'limit7'))
    with pytest.raises(AuditError, match=r'audit\.log: line 2: changed'):
        AuditLog(path)


def test_two_cannot_write_to_one_log(tmp_path: Path):
    with (
        AuditLog(tmp_path / 'audit.log'),
        pytest.raises(AuditError, match='another process writes'),
    ):
        AuditLog(tmp_path / 'audit.log')


@pytest.mark.parametrize('kept', [0, 1])
def test_a_log_whose_head_is_gone_is_not_whole(path: Path, kept: int):
    write(path, 3)
    path.write_bytes(b''.join(path.read_bytes().splitlines(keepends=True)[:kept]))
    head_path(path).unlink()
    found = read_log(path)
    assert (found.problem, found.bad_line) == ('cut', kept + 1)
    with pytest.raises(AuditError, match=r'LOG\.head is missing'):
        AuditLog(path)


def test_a_log_that_was_deleted_is_not_begun_again(path: Path):
    write(path, 2)
    path.unlink()
    with pytest.raises(AuditError, match='went on to entry 2'):
        AuditLog(path)


def test_a_log_without_an_entry_is_whole(tmp_path: Path):
    for _ in range(2):
        write(tmp_path / 'audit.log', 0)
        assert read_log(tmp_path / 'audit.log').whole


@pytest.mark.parametrize(
    'head', [b'[' * 100_000, b'{"sequence":' + b'9' * 6000 + b',"hash":""}\n', b'\xff' * 10**6]
)
def test_a_hostile_head_is_a_changed_one(path: Path, head: bytes):
    write(path, 1)
    head_path(path).write_bytes(head)
    assert read_log(path).problem == 'changed'
    with pytest.raises(AuditError, match=r'the file LOG\.head is not as it was written'):
        AuditLog(path)


def test_what_is_no_file_is_no_log(tmp_path: Path):
    with pytest.raises(AuditError, match='No such file'):
        AuditLog(tmp_path / 'nowhere/audit.log')
    (tmp_path / 'link').symlink_to('/dev/zero')
    with pytest.raises(AuditError, match='not a regular file'):
        read_log(tmp_path / 'link')


def _replace(path: Path) -> None:
    subprocess.run(['sed', '-i', 's/limit0/limit7/', str(path)], check=True)


def _copy_over(path: Path) -> None:
    shutil.copy(path, path.with_name('copy'))
    os.replace(path.with_name('copy'), path)


def _alter(path: Path) -> None:
    data = path.read_bytes()
    with path.open('r+b') as file:
        file.write(data.replace(b'limit0', b'limit7'))


@pytest.mark.parametrize(
    'tamper',
    [
        _replace,
        _copy_over,
        _alter,
        lambda path: path.write_bytes(b''),
        lambda path: os.truncate(path, 10),
        lambda path: path.unlink(),
        lambda path: path.rename(path.with_name('elsewhere')),
        lambda path: head_path(path).unlink(),
        lambda path: head_path(path).write_bytes(b'{}'),
        lambda path: path.write_bytes(path.read_bytes() * 2),
    ],
)
def test_a_log_that_was_tampered_with_while_it_is_open_is_not_written_to(
    path: Path, tmp_path: Path, tamper: Callable[[Path], object]
):
    with AuditLog(path) as log:
        append = partial(log.append, TIME, '/product', 'parameter', '/reject.limit0', 1)
        append(2)
        tamper(path)
        left = {each.name: each.read_bytes() for each in tmp_path.iterdir()}
        assert str(path) in log.trouble()
        for _ in range(2):
            with pytest.raises(AuditError, match='start the node product again'):
                append(3)
        assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == left


def test_a_log_that_was_moved_and_put_back_is_written_to(path: Path, tmp_path: Path):
    with AuditLog(path) as log:
        path.rename(tmp_path / 'elsewhere')
        assert log.trouble()
        (tmp_path / 'elsewhere').rename(path)
        path.chmod(0o600)
        assert not log.trouble()
        log.append(TIME, '/product', 'batch', 'batch', 'a', 'b')
    assert len(read_log(path).entries) == 1


def test_a_log_is_read_while_another_process_writes_to_it(path: Path):
    with AuditLog(path) as log:
        ended = threading.Event()

        def write_on() -> None:
            while not ended.is_set():
                log.append(TIME, '/product', 'batch', 'batch', 'a', 'b')

        writer = threading.Thread(target=write_on)
        writer.start()
        try:
            assert all(read_log(path).whole for _ in range(100))
        finally:
            ended.set()
            writer.join()


def test_an_entry_that_is_too_long_is_refused(tmp_path: Path):
    with AuditLog(tmp_path / 'audit.log') as log:
        with pytest.raises(AuditError, match='no room for an entry'):
            log.append(TIME, '/product', 'recipe', 'crisps', None, 'x' * 2**25)
        log.append(TIME, '/product', 'recipe', 'crisps', None, 'x')


@pytest.mark.parametrize('data', [b'some text', b'some text\n', b'\n', b'{}'])
def test_another_file_is_no_log(data: bytes):
    assert verify(data, b'').bad_line == 1


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


def test_a_log_names_the_one_before_which_must_not_go_on(tmp_path: Path):
    old, new = tmp_path / 'old.log', tmp_path / 'audit.log'
    write(old, 2)
    with AuditLog(old) as log:  # a command, while the line was off
        log.append(TIME, 'checkweigher', 'signature', 'L1', None, {})
    with AuditLog(new) as log:
        name_predecessor(log, TIME, '/product')
    chain = read_chain(new)
    assert ([path.name for path, _ in chain.logs], chain.fault) == (['old.log', 'audit.log'], '')
    write(old, 1)
    assert read_chain(new).fault == 'old.log does not end with the entry that audit.log names'
