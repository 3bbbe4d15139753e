# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Addresses of the page, which needs TLS for other machines."""

from pathlib import Path

import pytest

from checkweigher_core.whole_file import OutputError
from checkweigher_web.access.certificate import make_certificate
from checkweigher_web.access.site import PageError, Site
from checkweigher_web.access.users import Role, User, default_users, write_users


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Return the paths of certificate, key and users by the names of the options."""
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path))
    names = 'certificate', 'key', 'users'
    paths = {name: tmp_path / name for name in names}
    make_certificate(['scale7.local'], paths['certificate'], paths['key'])
    write_users(paths['users'], {'anna': User('anna', Role.VIEWER, '$argon2id$x')})
    return paths


def test_another_address_needs_certificate_and_key(files: dict[str, Path]):
    assert Site(host='0.0.0.0', **files).checked().secure
    for missing in ('certificate', 'key'):
        given = {name: path for name, path in files.items() if name != missing}
        with pytest.raises(PageError, match='--key'):
            Site(host='0.0.0.0', **given).checked()
    with pytest.raises(PageError, match='--key'):
        Site(host='192.168.1.7', users=files['users']).checked()


def test_users_that_are_not_there_yet_need_their_folder(files: dict[str, Path], tmp_path: Path):
    assert Site(users=tmp_path / 'new').checked().users == tmp_path / 'new'
    with pytest.raises(OutputError, match='there is no folder'):
        Site(users=tmp_path / 'none/users').checked()


def test_without_configuration_it_is_open_to_this_machine_alone(files: dict[str, Path]):
    site = Site().checked()
    assert (site.users, site.open, site.secure) == (default_users(), True, False)
    assert not default_users().exists()
    assert site.serves('127.0.0.1:8080')
    assert site.serves('localhost:9000')  # port of a tunnel
    assert site.serves('localhost')  # at port 80
    assert not site.serves('evil.example:8080')
    assert not site.serves('evil.example')
    assert not site.serves('')


def test_the_users_of_the_command_are_found(files: dict[str, Path], tmp_path: Path):
    (tmp_path / 'checkweigher').mkdir()
    files['users'].rename(tmp_path / 'checkweigher' / 'users')
    assert Site().checked().users == tmp_path / 'checkweigher' / 'users'


def test_behind_a_proxy_everybody_logs_in_and_the_origin_is_its(files: dict[str, Path]):
    site = Site(users=files['users'], origin='https://Scale.example:443/').checked()
    assert (site.open, site.secure, site.origin) == (False, True, 'https://scale.example')
    assert site.serves('scale.example')
    assert not site.serves('127.0.0.1:8080')
    for origin in ('http://scale.example', 'scale.example', 'https://scale.example/page'):
        with pytest.raises(PageError):
            Site(users=files['users'], origin=origin).checked()
