# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Users, and the users file."""

import json
import os
from pathlib import Path

from argon2 import extract_parameters
import pytest

from checkweigher_core.parameters import SettingsError
from checkweigher_web.access.users import (
    NOBODY,
    Role,
    User,
    UserFile,
    UsersError,
    check_name,
    hash_password,
    read_users,
    signing_key,
    write_users,
)

PASSWORD = 'correct horse'


def test_a_user_is_kept_with_a_hash_that_only_the_owner_of_the_file_reads(tmp_path: Path):
    path = tmp_path / 'users'
    anna = User('anna', Role.OPERATOR, hash_password('anna', PASSWORD))
    write_users(path, {'anna': anna})
    assert os.stat(path).st_mode & 0o777 == 0o600
    assert PASSWORD not in path.read_text()
    assert read_users(path) == {'anna': anna}
    assert anna.has_password(PASSWORD)
    assert not anna.has_password(PASSWORD + ' ')

    path.chmod(0o640)
    with pytest.raises(UsersError, match='chmod 600'):
        read_users(path)
    assert UserFile(path).find('anna') is None


@pytest.mark.parametrize(
    'name', ['', '../x', 'a/b', 'a:b', '.a', 'a b', '<script>', 'x' * 65, 'a\n']
)
def test_a_name_that_could_be_a_path_a_script_or_a_line_is_none(name: str):
    with pytest.raises(UsersError):
        check_name(name)


@pytest.mark.parametrize('password', ['short', 'x' * 129, 'JuergenK'])
def test_a_password_that_is_easy_to_guess_or_endless_is_refused(password: str):
    with pytest.raises(UsersError):
        hash_password('juergenk', password)


OLD = '# Users of the page, made by checkweigher user: NAME:ROLE:HASH\n'


def file_of(folder: Path, text: str) -> Path:
    path = folder / 'users'
    path.write_text(text)
    path.chmod(0o600)
    return path


def test_a_file_of_lines_is_read_and_written_as_a_table(tmp_path: Path):
    path = file_of(
        tmp_path, f'{OLD}anna:operator:$argon2id$x\n\n# of the shift\n@bob:viewer:$argon2id$y\n'
    )
    users = read_users(path)
    assert users == {
        'anna': User('anna', Role.OPERATOR, '$argon2id$x'),
        '@bob': User('@bob', Role.VIEWER, '$argon2id$y'),
    }
    write_users(path, users)
    assert json.loads(path.read_text())['format'] == 2
    assert read_users(path) == users


TABLE = '{"format": 2, "users": {"anna": {"role": "ROLE", "hash": "HASH"}}}'
BOSS, PLAIN = "'boss' is not one of viewer, operator", 'is not an argon2 hash; run: checkweigher'


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (f'{OLD}anna', 'line 2: anna.role: is missing; add it; a line is NAME:ROLE:HASH'),
        (f'{OLD}anna:boss:$argon2id$x', f'line 2: anna.role: {BOSS}'),
        (f'{OLD}anna:viewer:plain', f'line 2: anna.hash: {PLAIN}'),
        (f'{OLD}a:viewer:$argon2id$x\na:viewer:$argon2id$y', 'line 3: a is there twice; '),
        (f'{OLD}../a:viewer:$argon2id$x', "line 2: ../a: '../a': a name has up to 64 letters"),
        (TABLE.replace('ROLE', 'boss'), f'line 1: users.anna.role: {BOSS}'),
        (TABLE.replace('ROLE', 'viewer'), f'line 1: users.anna.hash: {PLAIN}'),
    ],
)
def test_a_file_that_is_none_of_users_is_refused(text: str, message: str, tmp_path: Path):
    path = file_of(tmp_path, text)
    with pytest.raises(SettingsError) as caught:
        read_users(path)
    assert str(caught.value).startswith(f'{path}: {message}')


def test_a_change_of_the_file_counts_at_once(tmp_path: Path):
    path, known = tmp_path / 'users', User('anna', Role.VIEWER, '$argon2id$x')
    file = UserFile(path)
    assert not file.now()  # the page also runs without a users file
    write_users(path, {'anna': known})
    assert file.now()
    assert file.find('anna') == known
    write_users(path, {})
    assert file.find('anna') is None


def test_an_unknown_name_takes_as_much_time_as_a_known_one():
    cost = extract_parameters(NOBODY.hash)
    assert cost == extract_parameters(hash_password('anna', PASSWORD))
    assert not NOBODY.has_password(PASSWORD)


def test_a_user_who_has_been_removed_cannot_sign(tmp_path: Path):
    path = tmp_path / 'users'
    write_users(path, {})
    anna = User('anna', Role.OPERATOR, hash_password('anna', PASSWORD))
    with pytest.raises(UsersError, match='anna has been removed'):
        signing_key(path, anna, PASSWORD)
