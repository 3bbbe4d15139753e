# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Login and guard of a real server, for a browser behind a proxy and for an attacker."""

import asyncio
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from html import unescape
from http.client import HTTPConnection
from http.cookies import SimpleCookie
import json
from pathlib import Path
import re
import time
from urllib.parse import urlencode

from nicegui import Client, core, ui
import pytest
from running import PATIENCE
from served_page import served
from starlette.requests import Request

from checkweigher_web.access.guard import Access
from checkweigher_web.access.site import Site
from checkweigher_web.access.users import Role, User, hash_password, read_users, write_users

HOST, PASSWORD = 'scale.example', 'correct horse'
ORIGIN = f'https://{HOST}'
IDLE = 4.0  # s
SOCKET = '/_nicegui_ws/socket.io'


@dataclass
class Answer:
    status: int
    headers: dict[str, str]
    cookies: SimpleCookie
    text: str

    @property
    def token(self) -> str:
        return re.findall(r'name=\\?"token\\?" value=\\?"([\w-]+)', self.text)[0]


class Browser:
    """HTTP client with cookies, headers and an address like a browser behind a proxy."""

    def __init__(self, port: int, address: str = '10.0.0.3') -> None:
        self.port, self.address = port, address
        self.cookies: dict[str, str] = {}

    @property
    def cookie(self) -> str:
        return '; '.join(f'{name}={value}' for name, value in self.cookies.items())

    def ask(self, path: str, fields: dict[str, str] | str | None = None, **headers: str) -> Answer:
        method, body = ('GET', None) if fields is None else ('POST', fields)
        body = urlencode(body) if isinstance(body, dict) else body
        known = {'Host': HOST, 'Cookie': self.cookie, 'X-Forwarded-For': self.address}
        known |= {'Origin': ORIGIN} if fields is not None else {}
        with closing(HTTPConnection('127.0.0.1', self.port, timeout=PATIENCE)) as connection:
            connection.request(method, path, body, {**known, **headers})
            answer = connection.getresponse()
            cookies: SimpleCookie = SimpleCookie()
            for text in answer.headers.get_all('Set-Cookie') or ():
                cookies.load(text)
            for name, each in cookies.items():
                self.cookies[name] = each.value
            return Answer(answer.status, dict(answer.headers), cookies, answer.read().decode())

    def log_in(
        self, name: str = 'anna', password: str = PASSWORD, token: bool = True, **headers: str
    ) -> Answer:
        fields = {'name': name, 'password': password}
        fields |= {'token': self.ask('/login').token} if token else {}
        return self.ask('/login', fields, **headers)

    def client(self) -> str:
        """Load the page, and return the identifier of its client."""
        return re.findall(r'client_id\W+([\w-]{36})', self.ask('/').text)[0]


@pytest.fixture(scope='module')
def users(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('site') / 'users'
    known = hash_password('x', PASSWORD)
    names = 'anna', 'mallory', 'carl', 'dora', 'zo\u00eb'
    write_users(path, {name: User(name, Role.TECHNICIAN, known) for name in names})
    return path


@pytest.fixture(scope='module')
def port(users: Path) -> Iterator[int]:
    options = '--users', str(users), '--origin', ORIGIN, '--idle', str(IDLE / 60)
    with served(*options, '--namespace', '') as (_, found):
        yield found


@pytest.fixture
def browser(port: int) -> Browser:
    return Browser(port)


def test_nothing_is_shown_before_the_login(browser: Browser):
    for path in ('/', '/lane/x', '/lane/../../etc/passwd', '/nowhere'):
        answer = browser.ask(path)
        assert (answer.status, answer.headers['location']) == (303, '/login')
    assert browser.ask(f'{SOCKET}/?EIO=4&transport=polling').status == 403
    login = browser.ask('/login')
    assert "default-src 'none'" in login.headers['content-security-policy']
    assert 'script' not in login.headers['content-security-policy']
    assert login.headers['cache-control'] == 'no-store'
    assert login.headers['strict-transport-security'] == 'max-age=31536000'


def test_a_login_gives_a_cookie_that_scripts_and_other_sites_do_not_get(browser: Browser):
    answer = browser.log_in()
    assert (answer.status, answer.headers['location']) == (303, '/')
    (name,) = [name for name in answer.cookies if not name.endswith('-form')]
    cookie = answer.cookies[name]
    assert name.startswith('__Host-')
    assert (cookie['httponly'], cookie['secure'], cookie['path']) == (True, True, '/')
    assert cookie['samesite'] == 'strict'
    page = browser.ask('/')
    assert page.status == 200
    assert 'anna' in page.text

    assert browser.ask('/logout', {'token': 'guessed'}).status == 403
    assert browser.ask('/').status == 200
    old = dict(browser.cookies)
    assert browser.ask('/logout', {'token': page.token}).status == 303
    browser.cookies = old  # a copy of the cookie is no longer valid
    assert browser.ask('/').status == 303


REFUSED: dict[str, dict[str, str | bool]] = {
    'no token': {'token': False},
    'foreign': {'Origin': 'https://evil.example'},
    'null': {'Origin': 'null'},
    'nobody': {'name': 'nobody'},
    'empty': {'password': ''},
    'path': {'name': '../../users'},
    'script': {'name': '<script>alert(1)</script>\r\nx: y'},
    'long': {'name': 'carl', 'password': 'x' * 10_000},
}


@pytest.mark.parametrize('case', REFUSED)
def test_a_login_that_is_none_is_refused(case: str, browser: Browser):
    # Each case has its own address, because failures of one address must wait.
    browser.address = f'10.1.0.{list(REFUSED).index(case)}'
    answer = browser.log_in(**REFUSED[case])  # type: ignore[arg-type]
    assert answer.status == 403
    assert '<script>' not in answer.text
    assert all(name.endswith('-form') for name in answer.cookies)


def test_an_identifier_that_was_planted_is_not_taken(browser: Browser, port: int):
    (name,) = [n for n in Browser(port).log_in().cookies if not n.endswith('-form')]
    planted = 'planted-by-somebody-who-waits'
    browser.cookies[name] = planted
    browser.log_in()
    assert (browser.cookies[name] != planted, browser.ask('/').status) == (True, 200)
    browser.cookies[name] = planted
    assert browser.ask('/').status == 303


def test_failures_in_a_row_have_to_wait(browser: Browser):
    browser.address = '10.2.0.1'
    assert [browser.log_in('carl', 'wrong horse').status for _ in range(3)] == [403] * 3
    # Even the correct password from another address must wait.
    browser.address = '10.2.0.2'
    answer = browser.log_in('carl')
    assert answer.status == 429
    assert int(answer.headers['retry-after']) >= 1
    deadline = time.monotonic() + PATIENCE
    while browser.log_in('carl').status != 303:
        assert time.monotonic() < deadline


def test_every_spelling_of_a_name_is_the_same_account(browser: Browser):
    for number, name in enumerate(['zo\u00eb', 'zoe\u0308', 'zo\u00eb']):
        browser.address = f'10.5.0.{number}'
        assert browser.log_in(name, 'wrong horse').status == 403
    assert browser.log_in('zoe\u0308').status == 429


def test_what_others_mistyped_at_the_same_address_is_over_with_a_login(browser: Browser):
    browser.address = '10.2.0.3'
    for number in range(4):  # Eight failures without a login would wait for 32 s.
        for name in (f'first{number}', f'second{number}'):
            assert browser.log_in(name, 'wrong horse').status == 403
        assert browser.log_in('anna').status == 303


def test_the_first_user_is_made_by_the_code_that_the_page_has_printed(tmp_path: Path):
    path = tmp_path / 'users'
    with served('--users', str(path), '--origin', ORIGIN, '--namespace', '') as (page, port):
        browser, code = Browser(port), re.findall('with the code ([0-9a-f]{10})', page.said)[0]
        assert browser.ask('/').headers['location'] == '/login'
        new = {'name': 'ann', 'password': PASSWORD}

        def make(**fields: str) -> Answer:
            return browser.ask('/login', {**new, **fields, 'token': browser.ask('/login').token})

        for fields in ({'code': code[:-1]}, {'code': code, 'password': 'short'}):
            browser.address += '0'
            assert make(**fields).status == 403
            assert not path.exists()
        # The terminal shows the code again with each form.
        assert f'with the code {code}' in page.stderr.readline()
        assert make(code=f' {code.upper()} ').headers['location'] == '/'
        assert 'ann, technician' in browser.ask('/').text
        assert read_users(path)['ann'].role == Role.TECHNICIAN
        browser.address = '10.0.0.9'
        assert make(name='eve', code=code).status == 403
        assert list(read_users(path)) == ['ann']


def open_socket(browser: Browser, client: str) -> tuple[str, str]:
    """Open a Socket.IO socket of a page, and return its path and the answer of the server."""
    query = f'client_id={client}&tab_id=t&document_id=d&implicit_handshake=true'
    path = f'{SOCKET}/?EIO=4&transport=polling&{query}'
    opened = json.loads(browser.ask(path).text.removeprefix('0'))
    path += f'&sid={opened["sid"]}'
    assert browser.ask(path, '40').status == 200
    return path, browser.ask(path).text


def test_a_socket_is_one_of_its_own_page_and_session(browser: Browser, port: int):
    browser.log_in()
    client, other = browser.client(), Browser(port)
    other.log_in('mallory')
    assert 'handshake failed' in open_socket(other, client)[1]
    assert open_socket(browser, client)[1].startswith('40{"sid"')


@pytest.mark.parametrize('transport', ['polling', 'websocket'])
def test_a_socket_of_a_page_of_another_site_is_refused(browser: Browser, transport: str):
    browser.address = f'10.4.0.{len(transport)}'
    browser.log_in()
    query = f'client_id={browser.client()}&tab_id=t&document_id=d&implicit_handshake=true'
    path = f'{SOCKET}/?EIO=4&transport={transport}&{query}'
    upgrade = {
        'Connection': 'Upgrade', 'Upgrade': 'websocket', 'Sec-WebSocket-Version': '13',
        'Sec-WebSocket-Key': 'AAAAAAAAAAAAAAAAAAAAAA==',
    }  # fmt: skip
    headers = upgrade if transport == 'websocket' else {}
    for origin in ('https://evil.example', 'null', f'{ORIGIN}.evil.example'):
        assert browser.ask(path, Origin=origin, **headers).status == 403
    assert browser.ask(path, Origin=ORIGIN, **headers).status == (101 if headers else 200)


def click_of(page: str, client: str, label: str) -> dict[str, object]:
    """Return the event that the page of a client sends for a click on a button."""
    parsed = re.search(r'parseElements\(String\.raw`(.*?)`', page, re.DOTALL)
    assert parsed, page[:3000]
    elements = json.loads(unescape(parsed[1]))
    ((number, button),) = [
        (number, each) for number, each in elements.items()
        if each.get('props', {}).get('label') == label
    ]  # fmt: skip
    (event,) = [each for each in button['events'] if each['type'] == 'click']
    own = {'id': int(number), 'client_id': client, 'args': ['{}']}
    return {**own, 'listener_id': event['listener_id']}


def read_until(browser: Browser, path: str, wanted: str) -> str:
    """Read from a socket until the text contains `wanted`, and return the text."""
    text, end = '', time.monotonic() + PATIENCE
    while wanted not in text:
        assert time.monotonic() < end, text
        text += browser.ask(path).text
        if text.endswith('2'):
            browser.ask(path, '3')
    return text


def test_an_event_from_the_socket_of_another_user_is_not_taken(port: int):
    victim, other = Browser(port, '10.3.0.4'), Browser(port, '10.3.0.7')
    victim.log_in('anna')
    other.log_in('mallory')
    pages = {browser: browser.ask('/').text for browser in (victim, other)}
    clients = {b: re.findall(r'client_id\W+([\w-]{36})', page)[0] for b, page in pages.items()}
    paths = {browser: open_socket(browser, client)[0] for browser, client in clients.items()}
    stop, zero = (click_of(pages[victim], clients[victim], name) for name in ('Stop', 'Zero'))
    # The number 1 asks the server to confirm the event.
    other.ask(paths[other], f'421{json.dumps(["event", stop])}')
    read_until(other, paths[other], '431[')
    victim.ask(paths[victim], f'42{json.dumps(["event", zero])}')
    shown = read_until(victim, paths[victim], 'becomes the zero')
    assert 'Weighing stops' not in shown
    # The server accepts the same event from the socket of the page.
    victim.ask(paths[victim], f'42{json.dumps(["event", stop])}')
    read_until(victim, paths[victim], 'Weighing stops')


def test_a_session_ends_with_its_user_and_with_time(browser: Browser, users: Path):
    browser.log_in('dora')
    assert browser.ask('/').status == 200
    known = read_users(users)
    dora = known.pop('dora')
    write_users(users, known)
    assert browser.ask('/').status == 303
    write_users(users, {**known, 'dora': dora})

    browser.log_in('dora')
    time.sleep(IDLE + 0.1)  # each request would use the session
    assert browser.ask('/').status == 303


def test_a_page_loads_again_at_the_second_look_after_its_session_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A browser may still be waiting for the answer to the logout at the first call of `expel`."""
    users = tmp_path / 'users'
    anna = User('anna', Role.VIEWER, '$argon2id$x')
    write_users(users, {'anna': anna})
    access = Access(Site(users=users))
    identifier = access.sessions.begin(anna, '127.0.0.1')
    scope = {'type': 'http', 'path': '/', 'headers': [], 'checkweigher.session': identifier}
    monkeypatch.setattr(Client, 'instances', {})  # without the clients of other tests

    async def look() -> list[bool]:
        monkeypatch.setattr(core, 'loop', asyncio.get_running_loop())
        client = Client(ui.page('/'), request=Request(scope))
        asked: list[str] = []
        monkeypatch.setattr(client, 'run_javascript', asked.append)
        access.sessions.end(identifier)
        found = []
        for _ in range(2):
            access.expel()
            found.append(asked == ['location.reload()'])
        return found

    assert asyncio.run(look()) == [False, True]
