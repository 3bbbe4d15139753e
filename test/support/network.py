# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hosts on a bad network: network namespaces of this machine with a switch of ours in between."""

from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
import json
import os
from pathlib import Path
import shutil
import struct
import subprocess
import sys

from running import PATIENCE, wait_for

from checkweigher_bringup.hosts.description import SERVER_PORT, LineDescription
from checkweigher_bringup.spinning import end_process

_TUNSETIFF, _TAP, _NO_HEADER = 0x400454CA, 0x0002, 0x1000  # linux/if_tun.h
_SWITCH, _SEED = Path(__file__).with_name('switch.py'), '1'


class NoNetworkError(Exception):
    """Error of a machine that cannot give hosts; the message says why."""


class Network:
    """Hosts 0, 1, ... in network namespaces, each with the address 10.75.0.(1 + number)."""

    def __init__(self, count: int) -> None:
        self._names = [f'checkweigher-{os.getpid()}-{number}' for number in range(count)]
        self._switch: subprocess.Popen[str] | None = None

    def command(self, host: int, **environment: str) -> list[str]:
        """Return the words that run a command on a host.

        A line is alone on its network: any address reaches it, unless `environment` says else.
        """
        given = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', **environment}
        words = [f'{name}={value}' for name, value in given.items()]
        return ['ip', 'netns', 'exec', self._names[host], 'env', *words]

    @contextmanager
    def discovery(self, kind: str) -> Iterator[dict[str, str]]:
        """Have the environment by which the nodes of all hosts find each other.

        `kind` is that of a line description: `hosts`, `subnet`, or the host of a server, which runs
        as long as the block: `host0`, `host1`, ...
        """
        hosts = {f'host{number}': _address(number) for number in range(len(self._names))}
        environment = LineDescription(hosts, (), kind).environment()
        if kind not in hosts:
            yield environment
            return
        program = Path(sys.executable).with_name('fast-discovery-server')
        words = [str(program), '-i', '0', '-l', hosts[kind], '-p', str(SERVER_PORT)]
        host, silent = list(hosts).index(kind), subprocess.DEVNULL
        server = subprocess.Popen([*self.command(host), *words], stdout=silent, stderr=silent)
        try:
            yield environment
        finally:
            server.terminate()
            end_process(server)

    def order(self, **orders: object) -> dict[str, int]:
        """Give the switch an order, see `switch.py`; return its counts."""
        assert self._switch is not None
        assert self._switch.stdin is not None
        assert self._switch.stdout is not None
        print(json.dumps(orders), file=self._switch.stdin, flush=True)
        counts: dict[str, int] = json.loads(self._switch.stdout.readline())
        return counts

    def make(self) -> None:
        """Make hosts and switch; `NoNetworkError` where that cannot be done."""
        if shutil.which('ip') is None:
            raise NoNetworkError('network namespaces need the command ip, of the package iproute2')
        if os.geteuid() != 0:
            raise NoNetworkError('network namespaces need root')
        descriptors = []
        try:
            for number, name in enumerate(self._names):
                _ip('netns', 'add', name)
                descriptors.append(_plug(number, name))
            self._start_switch(descriptors)
            for name in self._names:
                _wait_for_link(name)
        except (OSError, subprocess.CalledProcessError) as error:
            why = str(getattr(error, 'stderr', '') or error).strip()
            raise NoNetworkError(f'no network namespaces with TAP devices here: {why}') from None
        finally:
            for each in descriptors:
                os.close(each)

    def _start_switch(self, descriptors: list[int]) -> None:
        words = [sys.executable, str(_SWITCH), _SEED, *map(str, descriptors)]
        pipe = subprocess.PIPE
        self._switch = subprocess.Popen(
            words, stdin=pipe, stdout=pipe, text=True, pass_fds=descriptors
        )

    def remove(self) -> None:
        """Remove the hosts and their switch."""
        if self._switch is not None:
            self._switch.communicate(timeout=PATIENCE)
        for name in self._names:
            subprocess.run(['ip', 'netns', 'del', name], capture_output=True)


def _address(number: int) -> str:
    return f'10.75.0.{number + 1}'


def _plug(number: int, host: str) -> int:
    """Give a host its network device; return the descriptor of the other end."""
    device = f'cw{os.getpid()}n{number}'
    descriptor = os.open('/dev/net/tun', os.O_RDWR)
    fcntl.ioctl(descriptor, _TUNSETIFF, struct.pack('16sH14x', device.encode(), _TAP | _NO_HEADER))
    _ip('link', 'set', device, 'netns', host)
    _ip('-n', host, 'link', 'set', device, 'name', 'cable')
    _ip('-n', host, 'link', 'set', 'lo', 'up')
    _ip('-n', host, 'addr', 'add', f'{_address(number)}/24', 'dev', 'cable')
    _ip('-n', host, 'link', 'set', 'cable', 'multicast', 'on', 'up')
    return descriptor


def _wait_for_link(host: str) -> None:
    """Wait until the cable carries: DDS uses no interface that comes up after its node."""
    wait_for(lambda: 'tentative' not in _ip('-n', host, 'addr', 'show', 'cable'), 'the cable')


def _ip(*words: str) -> str:
    return subprocess.run(('ip', *words), capture_output=True, text=True, check=True).stdout


@contextmanager
def network(count: int) -> Iterator[Network]:
    """Have some hosts for as long as the block lasts; `NoNetworkError` where that cannot be."""
    hosts = Network(count)
    try:
        hosts.make()
        yield hosts
    finally:
        hosts.remove()
