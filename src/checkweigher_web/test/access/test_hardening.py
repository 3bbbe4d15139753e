# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Malformed events, slow requests, many page loads and a hang of a real server."""

import asyncio
import json
from pathlib import Path
import re
import socket
import subprocess
import sys
import time

from nicegui import Client, core, ui
import pytest
from running import PATIENCE
from served_page import get, get_text, served
from viewers import connect

from checkweigher_web.access.hardening import REQUEST, WAITING, forget_waiting

LINE = re.compile(r'\[WARN\] \[[\d.]+\] \[page\]: \S.*')
FORGED = 'raw\n[INFO] [1.0] [page]: forged'
HEAD = 'POST /login HTTP/1.1\r\nHost: 127.0.0.1:{0}\r\nOrigin: http://127.0.0.1:{0}\r\n'
SLOW = ('', 'GET / HTTP/1.1\r\nX: y', HEAD + 'Content-Length: 9\r\n\r\na')


def test_what_is_no_event_leaves_lines_and_no_traceback_in_the_log():
    with served() as (process, port):
        own, client = connect(port)
        known = {'client_id': client}
        said = {**known, 'level': 'error', 'message': FORGED}
        for name in ('log', 'event', 'javascript_response', 'ack', 'handshake', 'disconnect'):
            for given in ([], [None], [FORGED], [{'client_id': [FORGED]}], [known], [said, 1]):
                own.send('42' + json.dumps([name, *given]))
        for packet in ('42', '42{', '43[1]', '451-[1]', '4', 'x', f'40/{FORGED}'):
            own.send(packet)
        assert get(port).status == 200
        process.terminate()
        _, errors = process.communicate(timeout=PATIENCE)
    assert errors
    assert all(map(LINE.fullmatch, errors.splitlines()))
    assert 'forged' not in errors


def test_a_request_that_is_not_complete_in_time_ends():
    with served() as (process, port):
        begin = time.monotonic()
        slow = [socket.create_connection(('127.0.0.1', port), timeout=PATIENCE) for _ in SLOW]
        for each, text in zip(slow, SLOW, strict=True):
            each.sendall(text.format(port).encode())
        own, _ = connect(port)
        for each in slow:
            with each:
                assert each.recv(1) == b''
        assert time.monotonic() - begin > REQUEST - 1
        while time.monotonic() - begin < REQUEST + 3:  # the socket of a page has no time limit
            assert own.recv()
        process.terminate()
        assert process.communicate(timeout=PATIENCE)[1] == ''


def test_pages_without_a_browser_are_forgotten(monkeypatch: pytest.MonkeyPatch):
    async def flood() -> list[str]:
        monkeypatch.setattr(core, 'loop', asyncio.get_running_loop())
        page = ui.page('/')
        made = [Client(page) for _ in range(WAITING + 2)]
        made[0].environ = {}  # the oldest page has a browser
        forget_waiting()
        return [each.id for each in made if each.id not in Client.instances]

    monkeypatch.setattr(Client, 'instances', {})
    assert len(asyncio.run(flood())) == 1


@pytest.mark.soak
def test_memory_comes_back_after_600_loads():
    def mebibytes() -> float:
        status = Path(f'/proc/{process.pid}/status').read_text()
        return int(re.findall(r'VmRSS:\s+(\d+)', status)[0]) / 1024

    with served('--namespace', '') as (process, port):
        for count in (100, 600):
            before = mebibytes()
            for _ in range(count):
                get_text(port)
            print(f'{count} loads: {before:.0f} to {mebibytes():.0f} MiB')
        assert mebibytes() - before < 40


def test_a_page_that_hangs_ends_to_be_started_again():
    code = (
        'import time; from functools import partial; from nicegui import app;'
        'from checkweigher_web import server;'
        'server.HUNG = 1.5; server.Site = partial(server.Site, port=0);'
        'app.timer(3.0, lambda: time.sleep(1000), immediate=False); server.main()'
    )
    page = subprocess.run(
        [sys.executable, '-c', code], stderr=subprocess.PIPE, timeout=PATIENCE, check=False
    )
    assert page.returncode == 1
