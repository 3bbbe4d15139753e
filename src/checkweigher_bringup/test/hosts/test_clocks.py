# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Callable
import socket
import time

from graph import wait_for
import pytest

from checkweigher_bringup.hosts.clocks import HostClocks, answering
from checkweigher_dsp.health.findings import Level

HERE, THERE = '127.0.0.1', '127.0.0.2'


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((THERE, 0))
        return int(free.getsockname()[1])


def watched(port: int, clock: Callable[[], int], level: Level) -> None:
    clocks = HostClocks(HERE, {'server': THERE}, port)
    try:
        with answering(THERE, port, clock):
            wait_for(lambda: clocks.findings()[0].level == level)
    finally:
        clocks.close()


def test_two_addresses_of_one_computer_have_one_clock(port: int):
    watched(port, time.time_ns, Level.OK)


@pytest.mark.parametrize('ahead', [-1_000_000, 1_000_000])  # ns
def test_a_clock_that_is_a_millisecond_off_is_an_error(ahead: int, port: int):
    clocks = HostClocks(HERE, {'server': THERE}, port)
    try:
        with answering(THERE, port, lambda: time.time_ns() + ahead):
            wait_for(lambda: 'is off by' in clocks.findings()[0].text)
            values = clocks.findings()[0].values
            offset, uncertainty = (float(values[f'{n}_ms']) for n in ('offset', 'uncertainty'))
            assert abs(offset - ahead / 1e6) <= uncertainty
    finally:
        clocks.close()


def test_a_host_that_does_not_answer_is_an_error(port: int):
    clocks = HostClocks(HERE, {'server': THERE}, port)
    assert clocks.findings()[0].level == Level.ERROR
    clocks.close()
