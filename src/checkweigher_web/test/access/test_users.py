# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Users, and the file that they are kept in."""

import os
from pathlib import Path

import pytest

from checkweigher_web.access.users import (
    Role,
    User,
    UserFile,
    UsersError,
    check_name,
    hash_password,
    read_users,
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


@pytest.mark.parametrize(
    'line', ['anna', 'anna:boss:$argon2id$x', 'anna:viewer:plain', '../a:viewer:$argon2id$x']
)
def test_a_file_that_is_none_of_users_is_one_line(line: str, tmp_path: Path):
    path = tmp_path / 'users'
    path.write_text(line)
    path.chmod(0o600)
    with pytest.raises(UsersError):
        read_users(path)


def test_a_change_of_the_file_counts_at_once(tmp_path: Path):
    path, known = tmp_path / 'users', User('anna', Role.VIEWER, '$argon2id$x')
    file = UserFile(path)
    assert not file.any()  # the page may be served before it has users
    write_users(path, {'anna': known})
    assert file.any()
    assert file.find('anna') == known
    write_users(path, {})
    assert file.find('anna') is None
