# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command `user` for the users of the page."""

from concurrent.futures import ThreadPoolExecutor
from io import StringIO
from pathlib import Path

from here import run_here
import pytest
from running import run_command

from checkweigher_web.access.users import Role, read_users


def test_users_that_are_added_at_the_same_time_are_all_there(tmp_path: Path):
    path, names = tmp_path / 'users', [f'user{number}' for number in range(2)]
    words = '--role', 'viewer', '--users', path
    with ThreadPoolExecutor(len(names)) as pool:
        calls = [
            pool.submit(run_command, 'user', 'add', name, *words, input='battery staple')
            for name in names
        ]
    assert [call.result().returncode for call in calls] == [0] * len(names)
    assert sorted(read_users(path)) == names


def test_users_are_added_listed_changed_and_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / 'users'

    def run(*words: str, password: str = '') -> tuple[int, str]:
        monkeypatch.setattr('sys.stdin', StringIO(password))
        done = run_here('user', *words, '--users', path)
        return done.returncode, done.stdout + done.stderr

    added = run('add', 'anna', '--role', 'operator', password='correct horse\n')
    assert added == (0, f'{path}: anna added\n')
    before = read_users(path)['anna']
    assert before.role == Role.OPERATOR
    assert before.has_password('correct horse')
    assert run('list') == (0, 'anna  operator\n')

    for words in (
        ('add', 'anna', '--role', 'viewer'),
        ('remove', 'ben'),
        ('remove',),
        ('add', 'ben'),
    ):
        status, said = run(*words, password='battery staple\n')
        assert (status, said.count('\n')) == (2, 1)
    assert run('password', 'anna', password='short\n')[0] == 2
    assert read_users(path) == {'anna': before}

    assert run('password', 'anna', password='battery staple\n')[0] == 0
    assert read_users(path)['anna'].has_password('battery staple')
    assert run('remove', 'anna')[0] == 0
    assert read_users(path) == {}
