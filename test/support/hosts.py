# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two hosts with a cable between them: network namespaces of this machine, UDP and nothing else."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import shutil
import subprocess
import time

import pytest
from running import PATIENCE


class Hosts:
    """Hosts `a` and `b`, each with an address of its own.

    DDS takes the shared memory between two processes only if their hosts have the same addresses,
    so what passes from `a` to `b` passes through the cable.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def __getitem__(self, host: str) -> list[str]:
        """Return the words that run a command on a host."""
        # A line is alone on its network: any address reaches it.
        return [
            *('ip', 'netns', 'exec', self._host(host)),
            *('env', 'ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET'),
        ]

    def plug(self, *, unplug: bool = False) -> None:
        """Put the cable in, or pull it."""
        _ip('-n', self._host('b'), 'link', 'set', 'cable', 'down' if unplug else 'up')

    def received(self, host: str) -> int:
        """Return how many bytes have come through the cable."""
        path = '/sys/class/net/cable/statistics/rx_bytes'
        return int(_run('ip', 'netns', 'exec', self._host(host), 'cat', path))

    def make(self) -> None:
        """Make the hosts and plug the cable in."""
        for host in 'ab':
            _ip('netns', 'add', self._host(host))
            _ip('-n', self._host(host), 'link', 'set', 'lo', 'up')
            _ip('netns', 'exec', self._host(host), 'true')
        one, other = (('cable', 'netns', self._host(host)) for host in 'ab')
        _ip('link', 'add', *one, 'type', 'veth', 'peer', 'name', *other)
        for number, host in enumerate('ab', start=1):
            _ip('-n', self._host(host), 'addr', 'add', f'10.75.0.{number}/24', 'dev', 'cable')
            _ip('-n', self._host(host), 'link', 'set', 'cable', 'up')
        self._wait_for_link()

    def remove(self) -> None:
        """Remove the hosts; the cable goes with them."""
        for host in 'ab':
            subprocess.run(['ip', 'netns', 'del', self._host(host)], capture_output=True)

    def _host(self, host: str) -> str:
        return f'{self._name}{host}'

    def _wait_for_link(self) -> None:
        """Wait until the cable carries: DDS uses no interface that comes up after its node."""
        end = time.monotonic() + PATIENCE
        for host in 'ab':
            while True:
                shown = _ip('-n', self._host(host), 'addr', 'show', 'cable')
                if 'state UP' in shown and 'tentative' not in shown:
                    break
                assert time.monotonic() < end, shown
                time.sleep(0.05)


def _ip(*words: str) -> str:
    return _run('ip', *words)


def _run(*words: str) -> str:
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


@contextmanager
def two_hosts() -> Iterator[Hosts]:
    """Have two hosts; skip the test where this machine cannot give them."""
    if shutil.which('ip') is None:
        pytest.skip('network namespaces need the command ip, of the package iproute2')
    if os.geteuid() != 0:
        pytest.skip('network namespaces need root')
    hosts = Hosts(f'checkweigher-{os.getpid()}-')
    try:
        try:
            hosts.make()
        except subprocess.CalledProcessError as error:
            pytest.skip(f'no network namespaces here: {error.stderr.strip()}')
        yield hosts
    finally:
        hosts.remove()
