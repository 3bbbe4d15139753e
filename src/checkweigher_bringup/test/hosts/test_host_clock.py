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
import time

from graph import wait_for
import pytest

from checkweigher_core.health.findings import Finding, Level
from checkweigher_core.health.host_clock import COMMAND, ClockSteps, HostClock, tracking_finding

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
DRIFTING = FOLLOWS.replace('0.000000786', '0.150000000')


def test_the_bound_is_that_of_the_manual_of_chronyc():
    finding = tracking_finding(FOLLOWS)
    assert finding.level == Level.OK
    expected = 1e3 * (1.668e-6 + 0.786e-6 + 5.596e-6 / 2)
    assert finding.values['bound_ms'] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ('text', 'level', 'said'),
    [
        (LEADS, Level.OK, 'this clock is its own reference'),
        (LOST, Level.WARN, 'not synchronised'),
        (DRIFTING, Level.WARN, 'accurate to 150 ms'),
        ('', Level.WARN, 'does not answer'),
        (FOLLOWS[:60], Level.WARN, 'does not answer'),
    ],
)
def test_a_clock_that_nothing_keeps_is_told_of(text: str, level: Level, said: str):
    finding = tracking_finding(text)
    assert finding.level == level
    assert said in finding.message


def test_a_clock_that_is_set_makes_one_step(monkeypatch: pytest.MonkeyPatch):
    steps, real = ClockSteps(), time.time
    assert steps.step() == 0.0
    monkeypatch.setattr(time, 'time', lambda: real() - 3600)
    assert steps.step() == pytest.approx(-3600, abs=0.4)
    assert steps.step() == 0.0


def test_a_host_without_chrony_is_no_fault():
    finding = HostClock(('/nowhere/chronyc',)).finding(0.0)
    assert (finding.level, finding.text) == (Level.OK, 'not checked: chrony is not installed')


def answer(clock: HostClock) -> Finding:
    """Return the finding once the command has answered."""
    wait_for(lambda: clock.finding(time.monotonic()).text != 'not known yet')
    return clock.finding(time.monotonic())


def test_a_command_that_hangs_is_ended():
    clock = HostClock((sys.executable, '-c', 'import time; time.sleep(1000)'))
    clock.finding(0.0)
    assert clock.finding(9.0).text == 'not known yet'
    clock.finding(11.0)
    wait_for(lambda: clock.finding(12.0).text == 'chrony does not answer')


@contextmanager
def chronyd(folder: Path, *lines: str) -> Iterator[tuple[str, ...]]:
    """Run a daemon that sets no clock, and yield the command that queries it."""
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
        wait_for(lambda: answer(HostClock(follower)).level == Level.OK)
        assert 0 < float(answer(HostClock(follower)).values['bound_ms']) < 0.1
        assert answer(HostClock(leader)).text == 'this clock is its own reference in chrony (local)'
