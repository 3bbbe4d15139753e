# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Waiting times after failed logins, which increase with each failure."""

from types import SimpleNamespace

from checkweigher_web.access.throttle import Throttle


def test_waits_double_up_to_five_minutes_and_are_forgotten():
    clock = SimpleNamespace(now=0.0)
    throttle = Throttle(lambda: clock.now)
    waits = []
    for _ in range(14):
        throttle.fail('account anna', 'address 1')
        waits.append(throttle.wait('account anna', 'address 2'))
        clock.now += waits[-1]
        assert throttle.wait('account anna') == 0
    assert waits == [0, 0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 300, 300, 300]
    clock.now += 3601
    throttle.fail('account anna')
    assert throttle.wait('account anna') == 0


def test_an_address_that_tries_many_accounts_waits_and_others_do_not():
    throttle = Throttle(lambda: 0.0)
    for number in range(5):
        throttle.fail(f'account {number}', 'address 1')
    assert throttle.wait('account 9', 'address 1') == 4
    assert throttle.wait('account 9', 'address 2') == 0


def test_a_login_ends_the_row_of_its_account_and_address_and_of_no_other_account():
    throttle = Throttle(lambda: 0.0)
    for _ in range(4):
        throttle.fail('account anna', 'address 1')
        throttle.fail('account ben', 'address 1')
    throttle.forget('account anna', 'address 1')
    assert throttle.wait('account anna', 'address 1') == 0
    assert throttle.wait('account carl', 'address 1') == 0
    assert throttle.wait('account ben', 'address 1') == 2
