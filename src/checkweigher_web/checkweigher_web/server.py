# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The server of the page: one process, one node, the loopback address."""

from collections import Counter
import errno
import os
import socket
import sys

from fastapi import FastAPI, Response
from nicegui import app as nicegui
from nicegui import ui
import rclpy
from rclpy.signals import SignalHandlerOptions
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send
import uvicorn

from checkweigher_dsp.ros.spinner import Spinner
from checkweigher_web import PORT
from checkweigher_web.listening import Watch
from checkweigher_web.page import LanePage, list_lanes

ADDRESS = '127.0.0.1'
# What a page that shows, and that no other site may frame or read, says of itself. Vue compiles
# templates in the browser, hence unsafe-eval; nothing is loaded from elsewhere.
HEADERS = {
    'Content-Security-Policy': "default-src 'self'; script-src 'self' 'unsafe-inline' "
    "'unsafe-eval'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; font-src 'self' data:; "
    "connect-src 'self' ws: wss:; frame-ancestors 'none'; base-uri 'self'; form-action 'self'",
    'X-Content-Type-Options': 'nosniff',
    'X-Frame-Options': 'DENY',
    'Referrer-Policy': 'no-referrer',
}


class PageError(ValueError):
    """A page that cannot be served; one line that says why and what to do."""


def serve(namespace: str | None = None, port: int = PORT) -> None:
    """Serve the page until SIGINT or SIGTERM.

    Parameters
    ----------
    namespace : str, optional
        The one lane to show; None for all that run.
    port : int
        TCP port on the loopback address; 0 takes a free one.

    Raises
    ------
    PageError
        If the port cannot be used.
    """
    listener = _listen(port)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        spinner = Spinner()
        try:
            _serve(listener, spinner, namespace)
        finally:
            spinner.stop()
    finally:
        rclpy.try_shutdown()
        listener.close()


def _listen(port: int) -> socket.socket:
    try:
        return socket.create_server((ADDRESS, port))
    except OSError as error:
        hint = '; choose another one with --port' if error.errno == errno.EADDRINUSE else ''
        raise PageError(f'port {port}: {os.strerror(error.errno or 0).lower()}{hint}') from None
    except OverflowError:
        raise PageError(f'port {port}: is not in 0..65535') from None


class Guard:
    """Pass requests on to an ASGI application, and refuse those that another site has made.

    A site elsewhere can have a browser here open it under a name that points to this machine, or
    open a socket from a page of its own: neither may read what the line does.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one connection."""
        if scope['type'] not in ('http', 'websocket'):
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        host = connection.headers.get('host', '')
        origin = connection.headers.get('origin')
        if host.rpartition(':')[0] not in (ADDRESS, 'localhost'):
            refusal = Response('this page is served on the loopback address only', 421)
        elif origin not in (None, f'http://{host}'):
            refusal = Response('this request comes from another site', 403)
        else:
            await self._app(scope, receive, _with_headers(send))
            return
        if scope['type'] == 'websocket':
            await receive()
            await send({'type': 'websocket.close', 'code': 1008})  # the server answers 403
        else:
            await refusal(scope, receive, send)


def _with_headers(send: Send) -> Send:
    async def send_guarded(message: Message) -> None:
        if message['type'] == 'http.response.start':
            MutableHeaders(scope=message).update(HEADERS)
        await send(message)

    return send_guarded


def _serve(listener: socket.socket, spinner: Spinner, namespace: str | None) -> None:
    viewers: Counter[str] = Counter()
    watch = Watch(spinner, namespace)
    watch.viewers = lambda name: viewers[name]
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @ui.page('/', title='Checkweigher')
    async def overview() -> None:
        if len(watch.lanes) == 1:
            show(next(iter(watch.lanes)))
            return
        list_lanes(watch.lanes)

    @ui.page('/lane/{name:path}', title='Checkweigher')
    async def lane(name: str) -> None:
        show(name)

    def show(name: str) -> None:
        if name not in watch.lanes:
            ui.label(f'no lane {name!r} runs here')
            return
        client = ui.context.client
        client.on_connect(lambda: viewers.update([name]))
        client.on_disconnect(lambda: viewers.subtract([name]))
        LanePage(watch.lanes[name], watch.board)

    ui.run_with(app, title='Checkweigher', tailwind=False, show_welcome_message=False)
    address, port = listener.getsockname()
    # Said when the server has taken over the signals.
    nicegui.on_startup(
        lambda: print(f'page: http://{address}:{port}/', file=sys.stderr, flush=True)
    )
    server = uvicorn.Server(
        uvicorn.Config(Guard(app), log_level='warning', timeout_graceful_shutdown=2)
    )
    try:
        server.run(sockets=[listener])
    finally:
        watch.close()


def main() -> None:
    """Serve the page of all lanes."""
    try:
        serve()
    except PageError as error:
        print(f'checkweigher: {error}', file=sys.stderr)
        raise SystemExit(2) from None
