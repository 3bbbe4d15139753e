# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of batches: what is written is what is read, over restarts, torn lines and full disks."""

from dataclasses import asdict, replace
import hashlib
import json
import math
from pathlib import Path
import queue
import re

from full_disk import file_size_limit
import pytest

from checkweigher_core.records import Decision, Verdict, newer_fields
from checkweigher_production.batch_record import (
    RecordError,
    RecordState,
    RecordWriter,
    fault_of,
    read_events,
    record_path,
    records_in,
)

FAULT = Verdict(7, None, Decision.FAULT, ('NoLoad', 'Saturation'), late=True)
ACCEPT = Verdict(
    8, 3 * 10**18 + 1, Decision.ACCEPT, mass=0.1 + 0.2, std_dev=1e-4, batch='L 1', batch_items=8
)  # fmt: skip


def test_a_batch_that_is_gone_on_with_has_the_hash_of_its_whole_file(tmp_path: Path):
    writer = RecordWriter(tmp_path)
    writer.begin('L 1/a', 'noon', audit_hash='abc')
    writer.write('verdict', FAULT)
    writer.close()
    path = record_path(tmp_path, 'L 1/a')
    assert records_in(tmp_path) == ({'L 1/a': path}, [])
    stopped = writer.states.get(), writer.states.get()
    assert [each.event for each in stopped] == ['begun', 'stopped']
    with path.open('ab') as file:
        file.write(b'{"kind":"verdict","item_i')  # the power went

    writer = RecordWriter(tmp_path)
    writer.resume('L 1/a')
    writer.write('verdict', ACCEPT)
    writer.end('two')
    writer.resume('L 1/a')  # has ended
    writer.write('verdict', ACCEPT)
    writer.close()
    went_on, ended, again = (writer.states.get() for _ in range(3))
    assert writer.states.empty()

    (_, begin), *verdicts, (_, end) = read_events(path)
    assert begin == {'time': 'noon', 'batch': 'L 1/a', 'audit_hash': 'abc'}
    assert end == {'time': 'two'}
    found = [each for _, each in verdicts]
    assert found[1] == ACCEPT
    assert math.isnan(found[0].mass)
    assert (found[0].reasons, found[0].decision, found[0].late) == (
        FAULT.reasons,
        FAULT.decision,
        1,
    )
    data = path.read_bytes()
    whole = RecordState('L 1/a', 'ended', hashlib.sha256(data).hexdigest(), len(data))
    assert (ended, again) == (whole, whole)
    # What was left of a line by the power cut was no stop, so it is not held against the record.
    assert went_on == replace(stopped[1], event='continued')
    assert fault_of(data, [stopped[0], went_on, ended]) == ''


def chained(*lines: bytes) -> bytes:
    """Return lines with the hashes that the writer would give them."""
    data = b''
    for line in lines:
        data += line.partition(b',"hash"')[0]
        data += b',"hash":"%s"}\n' % hashlib.sha256(data).hexdigest().encode()
    return data


def test_a_record_that_was_changed_while_nobody_wrote_it_is_broken_for_good(tmp_path: Path):
    writer = RecordWriter(tmp_path)
    writer.begin('L1', 'noon')
    for number in range(1, 4):
        writer.write('verdict', Verdict(number, number, Decision.UNDER))
    writer.note()
    writer.close()
    states = [writer.states.get() for _ in range(3)]
    assert [each.event for each in states] == ['begun', 'written', 'stopped']
    path = record_path(tmp_path, 'L1')
    honest = path.read_bytes()
    begin, first, second, third = honest.splitlines(keepends=True)
    edited = first.replace(b'UNDER', b'ACCEPT')
    added = chained(begin, first, second, third, third)
    forgeries = {
        begin + edited + second + third: 'line 2: it or a line before',
        begin + first + third: 'line 3: it or a line before',
        begin + first + third + second: 'line 3: it or a line before',
        begin + re.sub(rb',"hash":"\w+"', b'', first) + second + third: 'line 2: it or a line',
        chained(begin, edited, second, third): 'its first',  # a forger can run this program
        chained(begin, first, third): 'its end was removed',
        begin + first: 'its end was removed',
        added: 'bytes were added after it was stopped',
        honest + b'{"kind"': '7 bytes were added after it was stopped',
    }
    for forged, reason in forgeries.items():
        assert reason in fault_of(forged, states), reason
    assert fault_of(honest, states) == ''
    # After a kill, the lines before the last state are still protected, and others may follow.
    assert 'its first' in fault_of(chained(begin, edited, second, third), states[:2])
    assert fault_of(added, states[:2]) == ''

    path.write_bytes(added)
    writer = RecordWriter(tmp_path)
    writer.resume('L1', 'one', states)
    writer.end('two')
    writer.close()
    broken, ended = writer.states.get(), writer.states.get()
    assert 'bytes were added' in broken.broken
    kinds = [kind for kind, _ in read_events(path)]
    assert kinds == ['begin', *4 * ['verdict'], 'broken', 'end']
    for known in ([], [ended], [*states, broken, ended]):  # and so it is without the log
        assert fault_of(path.read_bytes(), known) != ''


def test_lines_wait_for_a_disk_that_is_full(tmp_path: Path):
    path = record_path(tmp_path, 'L1')
    writer = RecordWriter(tmp_path)
    writer.begin('L1', 'noon')
    writer.close()
    writer = RecordWriter(tmp_path)
    with file_size_limit(path.stat().st_size + 10):
        writer.resume('L1')
        writer.write('verdict', ACCEPT)
        writer.end('two')
        assert writer.states.get(timeout=60).event == 'continued'
        with pytest.raises(queue.Empty):
            writer.states.get(timeout=0.5)
    ended = writer.states.get(timeout=60)
    writer.close()
    assert [kind for kind, _ in read_events(path)] == ['begin', 'verdict', 'end']
    assert (writer.trouble, ended.event) == ('', 'ended')
    assert fault_of(path.read_bytes(), [ended]) == ''


def test_a_writer_that_is_closed_says_what_the_disk_did_not_take(tmp_path: Path):
    with file_size_limit(10):
        writer = RecordWriter(tmp_path)
        writer.begin('L1', 'noon')
        writer.close()
    assert 'File too large' in writer.trouble
    assert not record_path(tmp_path, 'L1').exists()


def test_a_verdict_of_an_older_file_has_the_defaults_of_newer_fields(tmp_path: Path):
    values = asdict(ACCEPT) | {'kind': 'verdict', 'decision': 'ACCEPT'}
    older = {name: value for name, value in values.items() if name not in newer_fields(Verdict)}
    path = tmp_path / 'L1.jsonl'
    path.write_text(f'{{"kind":"begin","batch":"L1"}}\n{json.dumps(older)}\n', encoding='utf-8')
    assert len(older) < len(values)
    assert [event for _, event in read_events(path)][1:] == [ACCEPT]


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('{"kind":"verdict"}\n', '1: is no line of the record'),
        ('{"kind":"begin","batch":"L1"}\n[]\n', '2: is no line of the record'),
        ('not a record\n', '1: is no line of the record'),
        ('{"kind":"begin"}\n', '1: batch: None is not a name'),
        ('{"kind":"begin","batch":"L1","crc32":1}\n', '1: is not as it was written'),
        ('{"kind":"begin","batch":"L1"}\n{"kind":"verdict"}\n', '2: item_id is missing'),
    ],
)
def test_what_is_no_record_is_refused_with_its_line(tmp_path: Path, text: str, why: str):
    path = tmp_path / 'L1.jsonl'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(RecordError, match=rf'L1\.jsonl:{why}'):
        list(read_events(path))
