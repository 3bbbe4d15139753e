# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
import getpass
from pathlib import Path
import shutil
import socket
import subprocess
import sys
from tempfile import TemporaryDirectory

from graph import wait_for
import pytest

from checkweigher_bringup.hosts.chrony import COMMAND, Chrony, read_tracking
from checkweigher_bringup.hosts.clocks import HostClocks, answering
from checkweigher_dsp.health.host_clocks import LARGEST_OFFSET, KeptClock

# As chronyc 4.3 printed it; times in s.
FOLLOWS = (
    '7F000001,127.0.0.1,4,1795400319.343892722,-0.000001668,-0.000000008,0.000000165,-0.008,'
    '-0.000,0.039,0.000005596,0.000000786,0.3,Normal\n'
)
LEADS = (
    '7F7F0101,,3,1795400310.245569266,0.000000000,0.000000000,0.000000000,0.000,0.000,0.000,'
    '0.000000000,0.000000000,0.0,Normal\n'
)
LOST = '00000000,,0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised\n'


def test_the_bound_is_that_of_the_manual_of_chronyc():
    kept = read_tracking(FOLLOWS)
    assert kept is not None
    assert kept.reference == 0x7F000001
    assert kept.bound == pytest.approx(1.668e-6 + 0.786e-6 + 5.596e-6 / 2, abs=1e-12)


@pytest.mark.parametrize('text', [LEADS, LOST, '', '506 Cannot talk to daemon\n', FOLLOWS[:60]])
def test_a_clock_that_follows_nobody_is_not_kept(text: str):
    assert read_tracking(text) is None


@pytest.mark.parametrize('command', [('/nowhere/chronyc',), (sys.executable, '-c', 'exit(1)')])
def test_without_chrony_nothing_is_known(command: tuple[str, ...]):
    with Chrony(command) as chrony:
        assert chrony.kept is None


@contextmanager
def chronyd(folder: Path, *lines: str) -> Iterator[tuple[str, ...]]:
    """Run a daemon that sets no clock, and have the command that asks it."""
    socket_path = folder / 'chronyd.sock'
    file = folder / 'chrony.conf'
    own = ('cmdport 0', f'bindcmdaddress {socket_path}', f'pidfile {folder / "pid"}')
    file.write_text('\n'.join((*lines, *own)) + '\n')
    user = getpass.getuser()
    words = ['chronyd', '-x', '-n', '-u', user, '-f', str(file)]
    daemon = subprocess.Popen(words, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        wait_for(socket_path.exists)
        yield (COMMAND[0], '-h', str(socket_path), *COMMAND[1:])
    finally:
        daemon.terminate()
        daemon.wait()


@pytest.mark.skipif(shutil.which('chronyd') is None, reason='needs chronyd')
def test_two_clocks_that_a_real_chrony_keeps():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(('127.0.0.1', 0))
        port = int(free.getsockname()[1])
    serves = ('local stratum 3', f'port {port}', 'allow 127.0.0.1', 'bindaddress 127.0.0.1')
    follows = (f'server 127.0.0.1 port {port} iburst minpoll -2 maxpoll -2', 'port 0')
    # The name of a socket is short.
    with TemporaryDirectory() as one, TemporaryDirectory() as other, ExitStack() as stack:
        leader = stack.enter_context(chronyd(Path(one), *serves))
        follower = stack.enter_context(chronyd(Path(other), *follows))
        alone = stack.enter_context(Chrony(leader))
        found = stack.enter_context(Chrony(follower))
        wait_for(lambda: found.kept is not None)
        assert alone.kept is None
        assert found.kept is not None
        assert found.kept.reference == 0x7F000001
        assert 0 < found.kept.bound < LARGEST_OFFSET / 2
        assert_told(found)


def assert_told(kept: Chrony) -> None:
    """The other host hears of it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(('127.0.0.2', 0))
        port = int(free.getsockname()[1])
    clocks = HostClocks('127.0.0.1', {'server': '127.0.0.2'}, port, kept)
    try:
        with answering('127.0.0.2', port, chrony=kept):
            wait_for(lambda: float(clocks.findings()[0].values['bound_by_chrony_ms']) < 0.2)
    finally:
        clocks.close()


def test_what_chrony_says_there_is_told_here():
    told = Chrony()
    told.kept = KeptClock(5, 1e-5)
    assert_told(told)
