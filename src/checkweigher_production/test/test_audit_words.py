# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The words for an audit log and its entries, whose texts and values may be of any kind."""

from pathlib import Path

import pytest

from checkweigher_production.audit_log import FIRST_PREVIOUS, AuditLog, Entry, read_log, verify
from checkweigher_production.audit_words import changes, conclusion, shortened, steps_back


def entry(old: object, new: object, subject: str = 'reject') -> Entry:
    return Entry(1, '2026-05-28T06:00:00', '/product', 'found', subject, old, new, FIRST_PREVIOUS)


def test_the_conclusion_has_number_time_and_hash_of_the_last_entry_or_the_break(tmp_path: Path):
    log = tmp_path / 'audit.log'
    with AuditLog(log) as audit:
        assert conclusion(read_log(log)) == 'the chain is whole: 0 entries'
        for second in (1, 2):
            audit.append(f'2026-05-28T06:00:0{second}', '/product', 'zero', 'zero', None, second)
    last = f'the last one of 2026-05-28T06:00:02 has the hash {audit.last_hash}'
    assert conclusion(read_log(log)) == f'the chain is whole: 2 entries, {last}'
    log.write_bytes(log.read_bytes().replace(b'"new":1', b'"new":3'))
    assert conclusion(read_log(log)).startswith('BROKEN: line 1: changed: ')


def test_a_torn_end_is_told(tmp_path: Path):
    log = tmp_path / 'audit.log'
    with AuditLog(log) as audit:
        audit.append('2026-05-28T06:00:01', '/product', 'zero', 'zero', None, 1)
    head = (tmp_path / 'audit.log.head').read_bytes()
    found = conclusion(verify(log.read_bytes() + b'{"sequence":2,', head))
    assert found.endswith('; a last one was cut off by power loss')


@pytest.mark.parametrize(
    ('old', 'new', 'found'),
    [
        (0.14, 0.15, [('reject', 0.14, 0.15)]),
        ({'a': 1, 'b': 2}, {'a': 1, 'b': 3}, [('reject.b', 2, 3)]),
        ({'a': 1}, {'a': 1, 'b': 3}, [('reject.b', None, 3)]),
        (None, {'a': 1, 'b': 3}, [('reject', None, '2 values')]),
        ({'a': 1}, None, [('reject', {'a': 1}, None)]),
        ([1], {'a': 1}, [('reject', None, '1 values')]),
    ],
)
def test_what_an_entry_changed(old: object, new: object, found: list[tuple[str, object, object]]):
    assert changes(entry(old, new)) == found


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (None, '-'), ('crisps', 'crisps'), (0.15, '0.15'), ([1, 'a'], '[1, "a"]'), (True, 'true'),
        ('\x1b[2J', "'\\x1b[2J'"), ('a' * 41, 'a' * 37 + '...'),
    ],
)  # fmt: skip
def test_a_value_is_one_printable_line(value: object, text: str):
    assert shortened(value) == text


def test_a_time_that_goes_back_is_told_with_its_entry():
    times = '2026-10-25T03:00:00+02:00', '2026-10-25T02:00:00+01:00', '', '2026-01-01', '2025-01-01'
    entries = [Entry(n, time, '/product', 'zero', 'zero', 0, 1, '') for n, time in enumerate(times)]
    assert [*steps_back(entries)] == ['the time goes back by 31536000.000 s at entry 4']
