# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Notifications of a line to a socket as that of systemd, and the unit files."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import shutil
import signal
import socket
import subprocess
import time

from processes import pids_of
import pytest
from running import PATIENCE, ROOT, children, start_command, wait_for

from checkweigher_bringup.supervision.processes import SILENCE, START
from checkweigher_bringup.supervision.service_manager import Watchdog

FOLDER = ROOT / 'packaging/systemd'
SERVICES = sorted(FOLDER.glob('*.service'))
UNITS = [*SERVICES, *FOLDER.glob('*.timer')]
FED = b'READY=1\nWATCHDOG=1'

of_systemd = pytest.mark.skipif(
    shutil.which('systemd-analyze') is None, reason='needs systemd-analyze'
)


@contextmanager
def manager(address: str) -> Iterator[socket.socket]:
    """Yield the non-blocking socket of a service manager."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(address)
        listening.setblocking(False)
        yield listening


def received(listening: socket.socket) -> list[bytes]:
    """Return the notifications that have arrived."""
    found = []
    while True:
        try:
            found.append(listening.recv(4096))
        except BlockingIOError:
            return found


def wait_for_silence(listening: socket.socket) -> None:
    """Wait until no notification has arrived for three periods."""
    listening.settimeout(3.0)
    end = time.monotonic() + PATIENCE
    with suppress(TimeoutError):
        while listening.recv(4096):
            assert time.monotonic() < end, 'the watchdog is fed on'


@pytest.mark.parametrize('abstract', [False, True])
def test_the_watchdog_is_fed_while_each_node_reports(
    abstract: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    address = f'@{tmp_path}' if abstract else str(tmp_path / 'notify')
    monkeypatch.setenv('NOTIFY_SOCKET', address)
    with manager(address.replace('@', '\0')) as systemd:
        watchdog = Watchdog(['/driver', '/reject'])
        watchdog.heard('/driver', 0.0)
        watchdog.heard('/page', 0.0)  # not of the line
        watchdog.feed(0.0)
        assert received(systemd) == []
        watchdog.heard('/reject', 1.0)
        for now in (1.0, 1.1, SILENCE):
            watchdog.feed(now)
        assert received(systemd) == [FED, FED]  # once a second is enough
        watchdog.heard('/driver', SILENCE)
        watchdog.feed(SILENCE + 1.1)  # reject is silent
        assert received(systemd) == []
        watchdog.restarted(SILENCE + 2.0)
        watchdog.feed(START + SILENCE + 2.0)
        watchdog.feed(START + SILENCE + 2.1)
        assert received(systemd) == [FED]


def test_without_systemd_nothing_is_sent(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv('NOTIFY_SOCKET', raising=False)
    Watchdog([]).feed(0.0)


def test_systemd_hears_of_a_line_that_hangs_and_restarts_it(tmp_path: Path):
    address = str(tmp_path / 'notify')
    with manager(address) as systemd:
        run = start_command(
            *('run', '--namespace', 'watched', '--folder', tmp_path / 'machine'),
            stdout=subprocess.DEVNULL,
            env={**os.environ, 'NOTIFY_SOCKET': address},
        )
        try:
            assert wait_for(lambda: received(systemd), 'the end of the start')[0] == FED
            (line,) = pids_of(run.pid, 'line')
            os.kill(line, signal.SIGSTOP)
            wait_for_silence(systemd)
            assert pids_of(run.pid, 'line') == [line]  # `run` leaves it to systemd
            left = children(run.pid)
            os.kill(line, signal.SIGKILL)
            assert run.wait(timeout=PATIENCE) == 2
            assert run.stderr is not None
            assert 'line: killed by signal 9 (SIGKILL)\n' in run.stderr.read()
            assert not [pid for pid in left if Path(f'/proc/{pid}').exists()]
        finally:
            run.kill()
            run.communicate()


@of_systemd
def test_systemd_accepts_the_units(tmp_path: Path):
    for unit in UNITS:
        text = unit.read_text(encoding='utf-8')
        # The command is looked for where it is installed, which is not here.
        text = text.replace('ExecStart=checkweigher ', f'ExecStart={ROOT}/checkweigher ')
        (tmp_path / unit.name).write_text(text, encoding='utf-8')
    done = subprocess.run(
        ['systemd-analyze', 'verify', '--man=no', *map(str, sorted(tmp_path.iterdir()))],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, '')
    assert len(UNITS) == 4


@of_systemd
@pytest.mark.parametrize('unit', SERVICES, ids=lambda unit: unit.name)
def test_a_service_is_exposed_less_than_3_of_10(unit: Path):
    done = subprocess.run(
        ['systemd-analyze', 'security', '--offline=true', '--threshold=29', str(unit)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
