# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Server of the page as a separate process with a real port."""

from collections.abc import Callable, Iterator
import re
import signal
import socket
import subprocess
import sys

import pytest
from running import BAGS, PATIENCE, run_command
from served_page import get, get_text, served


@pytest.fixture(scope='module')
def port() -> Iterator[int]:
    with served() as (_, found):
        yield found


def test_the_page_is_served_with_its_guards(port: int):
    answer = get(port)
    assert answer.status == 200
    assert answer.headers['X-Frame-Options'] == 'DENY'
    assert "frame-ancestors 'none'" in answer.headers['Content-Security-Policy']
    assert 'http' not in answer.headers['Content-Security-Policy']
    assert 'Strict-Transport-Security' not in answer.headers


def test_a_name_that_points_here_is_refused(port: int):
    assert get(port, Host='evil.example').status == 421
    assert get(port, Host=f'localhost:{port}').status == 200


def test_only_the_loopback_address_listens(port: int):
    for address in {each[4][0] for each in socket.getaddrinfo(socket.gethostname(), None)}:
        if not str(address).startswith('127.'):
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection((address, port), timeout=PATIENCE).close()


@pytest.mark.parametrize('path', ['/lane/nowhere', '/lane/../../etc/passwd', '/lane/<script>'])
def test_a_lane_that_is_not_there_is_no_error(port: int, path: str):
    assert get(port, path.replace('<', '%3C').replace('>', '%3E')).status == 200


def test_a_port_that_is_taken_is_one_line(port: int):
    done = run_command('page', '--port', port)
    taken = f'checkweigher page: port {port}: address already in use; choose another one with'
    assert (done.returncode, done.stderr.count('\n')) == (2, 1)
    assert done.stderr.startswith(taken)


@pytest.mark.parametrize('ending', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_without_a_word(ending: signal.Signals):
    with served() as (process, _):
        process.send_signal(ending)
        _, errors = process.communicate(timeout=PATIENCE)
        assert errors == ''
        assert process.returncode == 128 + ending


def test_a_browser_that_leaves_while_it_loads_is_not_worth_a_word():
    with served() as (process, port):
        assets = re.findall(r'"(/_nicegui/[^"]+)"', get_text(port))
        assert len(assets) > 10
        for path in assets[:12]:  # error messages for these fit into the pipe
            with socket.create_connection(('127.0.0.1', port), timeout=PATIENCE) as left:
                left.sendall(f'GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n'.encode())
        assert get(port).status == 200
        process.terminate()
        _, errors = process.communicate(timeout=PATIENCE)
        assert errors == ''


def test_a_page_that_hangs_costs_the_line_nothing(rows: Callable[..., list[dict[str, str]]]):
    bag = BAGS / 'paper_90'
    with served() as (process, _):
        process.send_signal(signal.SIGSTOP)
        assert rows('replay', bag, '--rate', 0) == rows('weigh', bag)


def test_the_executable_of_the_launch_file_ends_in_order_by_ctrl_c():
    """The test chooses a free port, because the default port may be in use."""
    code = (
        'from functools import partial; from checkweigher_web import server; '
        'server.Site = partial(server.Site, port=0); server.main()'
    )
    with subprocess.Popen([sys.executable, '-c', code], stderr=subprocess.PIPE, text=True) as page:
        assert page.stderr.readline().startswith('page: http://127.0.0.1:')
        page.send_signal(signal.SIGINT)
        _, errors = page.communicate(timeout=PATIENCE)
    assert page.returncode == 0
    assert 'Traceback' not in errors
