# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Viewers of the page without a browser: sockets that take what a browser would be sent.

They speak as much of Socket.IO as it takes: the handshake of NiceGUI, events, and an answer to each
ping. A page is loaded anew for each viewer.
"""

from ast import literal_eval
from collections.abc import Iterator
from contextlib import contextmanager, suppress
import re
import threading
import time
from urllib.parse import urlencode

from running import PATIENCE
from served_page import get_text
from websocket import WebSocket, WebSocketException, create_connection


class Viewer:
    """One viewer; `seen` has the number of each item and when it was shown first, s."""

    def __init__(self, port: int) -> None:
        self.seen: dict[int, float] = {}
        self.messages = 0
        self._socket, _ = connect(port)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the page."""
        with suppress(WebSocketException, OSError):
            self._socket.close(timeout=1)
        self._thread.join(PATIENCE)

    def _listen(self) -> None:
        with suppress(WebSocketException, OSError):
            while text := self._socket.recv():
                self._take(str(text), time.monotonic())

    def _take(self, text: str, now: float) -> None:
        if text == '2':
            self._socket.send('3')
            return
        self.messages += 1
        # The label of the latest item; those of the list are buttons.
        for number in re.findall(r'"item (\d+), ', text):
            self.seen.setdefault(int(number), now)


@contextmanager
def viewers(port: int, count: int) -> Iterator[list[Viewer]]:
    """Have some viewers while the block lasts."""
    found: list[Viewer] = []
    try:
        for _ in range(count):
            found.append(Viewer(port))
        yield found
    finally:
        for each in found:
            each.close()


def connect(port: int) -> tuple[WebSocket, str]:
    """Load the page and open its socket; where the server has forgotten the page, once more.

    Returns the socket and the number of the page.
    """
    address, end = f'127.0.0.1:{port}', time.monotonic() + PATIENCE
    while True:
        page = get_text(port)
        found = re.search(r'query: (\{.*?\})', page)
        assert found, page[:200]
        query = {
            **literal_eval(found[1]), 'implicit_handshake': 'true', 'document_id': 'a',
            'tab_id': 'a', 'EIO': 4, 'transport': 'websocket',
        }  # fmt: skip
        socket = create_connection(
            f'ws://{address}/_nicegui_ws/socket.io/?{urlencode(query)}', timeout=PATIENCE,
            origin=f'http://{address}', skip_utf8_validation=True,
        )  # fmt: skip
        assert socket.recv()[0] == '0'
        socket.send('40')
        answer = str(socket.recv())
        if answer.startswith('40'):
            return socket, query['client_id']
        socket.close()
        assert time.monotonic() < end, answer
