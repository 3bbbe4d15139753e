# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The audit trail: each change once, with its author and the value before, across restarts."""

from collections.abc import Mapping
import errno
import math
import os
from pathlib import Path

from full_disk import file_size_limit
import pytest

from checkweigher_production.audit_log import AuditError, AuditLog, read_log
from checkweigher_production.audit_trail import AuditTrail, Author, Authors

TIME = '2026-01-01T00:00:00.000000+00:00'
NODE = '/lane1/reject'
FULL = os.strerror(errno.ENOSPC)


def session(path: Path, values: Mapping[str, object], *changes: tuple[str, object]) -> None:
    """Start the line with some parameters, change some, and stop it."""
    with AuditLog(path) as log:
        trail = AuditTrail(log, '/lane1/product', lambda: TIME)
        trail.found(NODE, values)
        for name, value in changes:
            trail.parameters(NODE, {name: value})


def entries(path: Path) -> list[tuple[str, str, object, object]]:
    found = read_log(path)
    assert found.whole
    return [(entry.kind, entry.subject, entry.old, entry.new) for entry in found.entries]


def test_a_change_has_its_old_and_its_new_value(tmp_path: Path):
    path = tmp_path / 'audit.log'
    session(path, {'lower_limit': -math.inf}, ('lower_limit', 0.13), ('lower_limit', 0.14))
    assert entries(path)[1:] == [
        ('parameter', f'{NODE}.lower_limit', '-inf', 0.13),
        ('parameter', f'{NODE}.lower_limit', 0.13, 0.14),
    ]


def test_what_did_not_change_is_not_written(tmp_path: Path):
    path = tmp_path / 'audit.log'
    values = {'lower_limit': -math.inf, 'speeds': (0.5, 1.0)}
    session(path, values)
    session(path, values)
    assert len(entries(path)) == 1


def test_a_limit_that_a_product_had_changed_is_written_when_it_is_set_back(tmp_path: Path):
    path = tmp_path / 'audit.log'
    session(path, {'lower_limit': -math.inf}, ('lower_limit', -math.inf))
    assert entries(path)[1:] == [('parameter', f'{NODE}.lower_limit', '-inf', '-inf')]


def test_a_parameter_file_that_was_edited_in_between_is_noticed(tmp_path: Path):
    path = tmp_path / 'audit.log'
    session(path, {'lower_limit': 0.1, 'upper_limit': 0.2}, ('upper_limit', 0.3))
    session(path, {'lower_limit': 0.1, 'upper_limit': 0.2})
    assert entries(path)[-1] == ('found', NODE, {'upper_limit': 0.3}, {'upper_limit': 0.2})


def test_recipes_that_were_changed_or_removed_are_noticed(tmp_path: Path):
    path = tmp_path / 'audit.log'
    for recipes in ({'a': {'nominal': 1.0}, 'b': {'nominal': 2.0}}, {'a': {'nominal': 1.5}}):
        with AuditLog(path) as log:
            AuditTrail(log, '/product', lambda: TIME).recipes(recipes)
    assert entries(path)[2:] == [
        ('recipe', 'a', {'nominal': 1.0}, {'nominal': 1.5}),
        ('recipe', 'b', {'nominal': 2.0}, None),
    ]


def test_a_calibration_is_written_when_it_is_another(tmp_path: Path):
    path = tmp_path / 'audit.log'
    for counts in (5e5, 5e5, 4e5):
        with AuditLog(path) as log:
            trail = AuditTrail(log, '/product', lambda: TIME)
            trail.state('calibration', 'load_cell/info', {'counts_per_kg': counts})
    assert entries(path) == [
        ('calibration', 'load_cell/info', None, {'counts_per_kg': 5e5}),
        ('calibration', 'load_cell/info', {'counts_per_kg': 5e5}, {'counts_per_kg': 4e5}),
    ]


def test_what_happened_while_the_disk_was_full_is_written_later_with_its_own_time(tmp_path: Path):
    path, times = tmp_path / 'audit.log', iter(range(100))
    with AuditLog(path) as log:
        trail = AuditTrail(log, '/product', lambda: f'at {next(times)}')
        with file_size_limit(10):
            for _ in range(2):  # what is latched comes again
                trail.saw_state('calibration', 'load_cell/info', {'counts_per_kg': 5e5})
            with pytest.raises(AuditError, match=FULL):
                trail.parameters(NODE, {'lower_limit': 0.1})
            trail.saw('restored', 'reject', None, 'nuts')
            assert FULL in trail.trouble
        trail.parameters(NODE, {'lower_limit': 0.2})
        assert trail.trouble == ''
    found = read_log(path)
    assert found.whole
    assert [(entry.time, entry.kind, entry.new) for entry in found.entries] == [
        ('at 0', 'calibration', {'counts_per_kg': 5e5}),
        ('at 1', 'restored', 'nuts'),
        ('at 2', 'refused', f'1 change, because the log could not be written: {path}: {FULL}'),
        ('at 3', 'parameter', 0.2),
    ]


def test_who_calls_a_service_is_its_author_until_the_call_has_ended():
    authors, ann = Authors(patience=10.0), Author('ann', 'order 7')
    assert authors.of('select_product', '/product', 0.0) == Author('graph:/product')

    authors.announce(ann, ['select_product'], 1.0)
    assert authors.of('select_product', '/product', 2.0) == ann
    assert authors.of('new_batch', '/product', 2.0) == Author('graph:/product')

    authors.announce(ann, [], 3.0)
    assert authors.of('select_product', '/product', 3.0) == Author('graph:/product')


def test_two_persons_at_once_keep_their_own_services_until_they_are_forgotten():
    authors = Authors(patience=10.0)
    authors.announce(Author('ann'), ['zero'], 1.0)
    authors.announce(Author('bob'), ['new_batch'], 1.5)
    assert authors.of('zero', '/segmenter', 2.0).who == 'ann'
    assert authors.of('zero', '/segmenter', 11.5) == Author('graph:/segmenter')
    assert authors.of('new_batch', '/product', 2.0).who == 'bob'
