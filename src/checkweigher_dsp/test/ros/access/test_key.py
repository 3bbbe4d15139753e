# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
import hashlib
import hmac
from pathlib import Path

import pytest

from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.records import NANOSECONDS
from checkweigher_dsp.ros.access.key import KEY_FILE, LONGEST_AGE, Key, Lock, own_key, read_key

SECRET = b'0123456789abcdef' * 2
NOW = 1_700_000_000 * NANOSECONDS


def opened(lock: Lock, permission: str, service: str = '/zero', asked: str = '()') -> bool:
    return lock.opens(permission, service, asked, NOW)


def test_a_permission_is_an_hmac_of_time_service_and_what_is_asked():
    signed = Key(SECRET).sign('/zero', '()', NOW)
    expected = hmac.new(SECRET, f'{NOW}\0/zero\0()'.encode(), hashlib.sha256).hexdigest()
    assert signed == f'{NOW} {expected}'


def test_a_permission_counts_once():
    lock, signed = Lock(Key(SECRET)), Key(SECRET).sign('/zero', '()', NOW)
    assert opened(lock, signed)
    assert not opened(lock, signed)


def test_a_permission_is_for_one_service_and_one_request():
    lock, signed = Lock(Key(SECRET)), Key(SECRET).sign('/zero', '()', NOW)
    assert not opened(lock, signed, '/reset_stop_request')
    assert not opened(lock, signed, asked='(other)')
    assert opened(lock, signed)


def test_another_key_opens_nothing():
    assert not opened(Lock(Key(SECRET)), Key(SECRET[::-1]).sign('/zero', '()', NOW))


@pytest.mark.parametrize('ahead', [-1, 1])
def test_a_permission_of_another_time_opens_nothing(ahead: int):
    away = ahead * round(LONGEST_AGE * NANOSECONDS)
    lock = Lock(Key(SECRET))
    assert not opened(lock, Key(SECRET).sign('/zero', '()', NOW + away))
    assert opened(lock, Key(SECRET).sign('/zero', '()', NOW + away - ahead * NANOSECONDS))


@pytest.mark.parametrize('said', ['', ' ', 'now', '-1 a', '9' * 30, f'{NOW} ', f'{NOW} é', '٣ a'])
def test_what_is_no_permission_opens_nothing(said: str):
    lock = Lock(Key(SECRET))
    lock.expect(said, NOW)
    assert not opened(lock, said)
    assert not lock.admits('/zero', '()', NOW)


def test_an_expected_permission_admits_one_call():
    lock = Lock(Key(SECRET))
    lock.expect(Key(SECRET).sign('/zero', '()', NOW), NOW)
    assert not lock.admits('/reset_stop_request', '()', NOW)
    assert lock.admits('/zero', '()', NOW)
    assert not lock.admits('/zero', '()', NOW)


def test_an_expected_permission_gets_too_old():
    lock = Lock(Key(SECRET))
    lock.expect(Key(SECRET).sign('/zero', '()', NOW), NOW)
    assert not lock.admits('/zero', '()', NOW + round(LONGEST_AGE * NANOSECONDS))


def test_a_key_is_read_from_a_file_of_its_owner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / 'key'
    path.write_bytes(SECRET + b'\n')
    path.chmod(0o600)
    signed = Key(SECRET).sign('/zero', '()', NOW)
    assert read_key(path).sign('/zero', '()', NOW) == signed
    monkeypatch.setenv(KEY_FILE, str(path))
    own = own_key()
    assert own is not None
    assert own.sign('/zero', '()', NOW) == signed
    monkeypatch.delenv(KEY_FILE)
    assert own_key() is None


def test_a_key_that_others_may_read_or_that_is_short_is_refused(tmp_path: Path):
    path = tmp_path / 'key'
    with pytest.raises(ParameterError, match='No such file'):
        read_key(path)
    path.write_bytes(SECRET)
    path.chmod(0o640)
    with pytest.raises(ParameterError, match='chmod 600'):
        read_key(path)
    path.chmod(0o600)
    path.write_bytes(b'short')
    with pytest.raises(ParameterError, match='32 bytes at least'):
        read_key(path)
