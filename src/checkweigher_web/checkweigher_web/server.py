# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The server of the page: one process, on the loopback address unless it may be elsewhere."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
import errno
from functools import partial
import os
from pathlib import Path
import socket
import sys

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from fastapi import FastAPI, Response
from nicegui import app as nicegui
from nicegui import ui
import rclpy
from rclpy.signals import SignalHandlerOptions
import uvicorn

from checkweigher_core.ros.spinner import Spinner
from checkweigher_web.access.guard import Access, Guard, bind_events
from checkweigher_web.access.login import add_login
from checkweigher_web.access.site import PageError, Site
from checkweigher_web.access.users import Role
from checkweigher_web.audit_view import Auditor
from checkweigher_web.drawing import Drawing
from checkweigher_web.header import header, hint_to_users
from checkweigher_web.lane import SHOWN
from checkweigher_web.listening import Watch
from checkweigher_web.overview import Overview, show_overview, wait_for_lane
from checkweigher_web.page import LanePage
from checkweigher_web.playback_page import PlaybackPage
from checkweigher_web.shift import Shift
from checkweigher_web.work.bar import keep_item, work_bar
from checkweigher_web.work.dialogs import Desk
from checkweigher_web.work.keeping import HELD, Keeper
from checkweigher_web.work.reports import add_reports
from checkweigher_web.work.services import Workshop

_LOOK_PERIOD = 1.0  # s
_AWAY = 15.0  # s, for which a browser without network keeps its page, and a dialog on it
_LARGEST_MESSAGE = 1 << 20  # bytes, of a browser
STYLE = Path(__file__).with_name('page.css')
_REPORT = '/report'
# Of a file that somebody made elsewhere: nothing in it runs, and it reaches nothing.
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'; sandbox"
)


def serve(
    site: Site, namespace: str | None = None, keep: Path | None = None,
    trust: Ed25519PublicKey | None = None,
) -> None:  # fmt: skip
    """Serve the page until SIGINT or SIGTERM.

    Parameters
    ----------
    site : Site
        Where, and to whom; port 0 takes a free one.
    namespace : str, optional
        The one lane to show; None for all that run.
    keep : Path, optional
        Folder to which persons may keep items.
    trust : Ed25519PublicKey, optional
        Key by which the seals of audit logs are verified.

    Raises
    ------
    PageError, CertificateError, SettingsError
        If the site cannot be served.
    """
    with _listening(site) as (found, listener):
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        try:
            spinner = Spinner()
            try:
                _serve(found, listener, spinner, namespace, keep, Auditor(trust))
            finally:
                spinner.stop()
        finally:
            rclpy.try_shutdown()


def serve_shift(site: Site, shift: Shift, name: str, report: Path | None = None) -> None:
    """Serve the page of a recorded shift until SIGINT or SIGTERM.

    Parameters
    ----------
    site : Site
        Where, and to whom; port 0 takes a free one.
    shift : Shift
        What to show; it is weighed meanwhile.
    name : str
        What the page calls it.
    report : Path, optional
        HTML file of `evaluate` that the page links to.

    Raises
    ------
    PageError, CertificateError, SettingsError
        If the site cannot be served.
    """
    with _listening(site) as (found, listener):
        access, app = _application(found)
        if report is not None:
            text = report.read_bytes()

            @app.get(_REPORT)
            def answer() -> Response:
                headers = {'Content-Security-Policy': REPORT_POLICY}
                return Response(text, media_type='text/html; charset=utf-8', headers=headers)

        @ui.page('/', title='Checkweigher')
        async def show() -> None:
            header(access, '')
            PlaybackPage(shift, name, _REPORT if report is not None else '')

        shift.start()
        _run(app, access, listener)


@contextmanager
def _listening(site: Site) -> Iterator[tuple[Site, socket.socket]]:
    """Listen at a site, and have it with its port."""
    site = site.checked()
    listener = _listen(site)
    try:
        yield replace(site, port=listener.getsockname()[1]), listener
    finally:
        listener.close()


def _listen(site: Site) -> socket.socket:
    where = f'port {site.port}' if site.loopback else f'{site.host} port {site.port}'
    try:
        (family, *_, address), *_ = socket.getaddrinfo(
            site.host, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        return socket.create_server((address[0], site.port), family=family)
    except socket.gaierror as error:
        raise PageError(f'--host {site.host}: {error.strerror}') from None
    except OSError as error:
        hint = '; choose another one with --port' if error.errno == errno.EADDRINUSE else ''
        raise PageError(f'{where}: {os.strerror(error.errno or 0).lower()}{hint}') from None
    except OverflowError:
        raise PageError(f'{where}: is not in 0..65535') from None


def _serve(
    site: Site, listener: socket.socket, spinner: Spinner, namespace: str | None,
    keep: Path | None, auditor: Auditor,
) -> None:  # fmt: skip
    access, app = _application(site)
    if keep is not None and not access.users.any():
        raise PageError('--keep: needs a user: checkweigher user add NAME --role R')
    keeper = None if keep is None else Keeper(keep)
    viewers: Counter[str] = Counter()
    watch = Watch(spinner, namespace, SHOWN if keep is None else HELD)
    watch.viewers = lambda name: viewers[name]
    workshop = Workshop(spinner)
    drawings: dict[str, Drawing] = {}
    lanes = Overview(watch)

    add_reports(app, workshop, REPORT_POLICY)

    @ui.page('/', title='Checkweigher')
    async def overview() -> None:
        if (only := lanes.only()) is not None:
            show(only)
            return
        header(access, '')
        show_overview(lanes)

    @ui.page('/lane/{name:path}', title='Checkweigher')
    async def lane(name: str) -> None:
        show(name)

    def show(name: str) -> None:
        if name not in watch.lanes:
            header(access, name, lambda: True)
            wait_for_lane(name, lambda: name in watch.lanes)
            return
        client = ui.context.client
        client.on_connect(lambda: viewers.update([name]))
        client.on_disconnect(lambda: viewers.subtract([name]))
        header(access, name, lambda: lanes.only() is None)
        keeping = None
        desk = Desk(access, watch.lanes[name], partial(workshop.of, name), auditor)
        hint_to_users(access)
        if desk.role >= Role.OPERATOR:
            work_bar(desk)
            if keeper is not None:
                keeping = partial(keep_item, desk, keeper)
        drawing = drawings.setdefault(name, Drawing(watch.lanes[name]))
        LanePage(drawing, watch.board, keeping)

    try:
        _run(app, access, listener)
    finally:
        watch.close()


def _application(site: Site) -> tuple[Access, FastAPI]:
    """Return who may do what at a site, and the application with its login."""
    access = Access(site)
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    add_login(app, access, STYLE)
    return access, app


def _run(app: FastAPI, access: Access, listener: socket.socket) -> None:
    site = access.site
    ui.run_with(
        app, title='Checkweigher', tailwind=False, show_welcome_message=False,
        reconnect_timeout=_AWAY,
    )  # fmt: skip
    bind_events(access)

    nicegui.timer(_LOOK_PERIOD, access.expel)
    # Said when the server has taken over the signals.
    nicegui.on_startup(lambda: print(f'page: {site.address}', file=sys.stderr, flush=True))
    config = uvicorn.Config(
        Guard(app, access), log_level='warning', timeout_graceful_shutdown=2, server_header=False,
        ssl_certfile=site.certificate, ssl_keyfile=site.key, ws_max_size=_LARGEST_MESSAGE,
        ws_per_message_deflate=False,  # most of the work for a viewer, and wires are fast here
        # Only a reverse proxy may tell where a browser is.
        proxy_headers=bool(site.origin),
    )  # fmt: skip
    uvicorn.Server(config).run(sockets=[listener])


def main() -> None:
    """Serve the page of all lanes."""
    try:
        serve(Site())
    except KeyboardInterrupt:
        pass  # uvicorn hands Ctrl-C on when it has ended
    except ValueError as error:
        print(f'checkweigher: {error}', file=sys.stderr)
        raise SystemExit(2) from None
