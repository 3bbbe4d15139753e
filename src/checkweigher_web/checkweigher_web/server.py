# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Web server of the page, by default on the loopback address."""

import argparse
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
import errno
import faulthandler
from functools import partial
import os
from pathlib import Path
import socket
import sys

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from fastapi import FastAPI
from fastapi.responses import HTMLResponse
from nicegui import app as nicegui
from nicegui import ui
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
import uvicorn

from checkweigher_core.parent_process import end_with_parent
from checkweigher_core.ros.graph.policy import PAGE, enclave_arguments
from checkweigher_core.ros.spinner import Spinner
from checkweigher_web import ADDRESS
from checkweigher_web.access.guard import LOGIN, Access, Guard, bind_events
from checkweigher_web.access.hardening import PromptProtocol, forget_waiting, log_in_lines
from checkweigher_web.access.login import add_login, first_user
from checkweigher_web.access.site import PageError, Site
from checkweigher_web.access.users import Role
from checkweigher_web.commissioning.path import CommissioningPath
from checkweigher_web.drawing import Drawing
from checkweigher_web.elements import STYLE
from checkweigher_web.header import header, hint_to_users, page_language
from checkweigher_web.lane import SHOWN
from checkweigher_web.languages.language import Language, Text
from checkweigher_web.listening import Watch
from checkweigher_web.overview import Overview, show_overview, wait_for_lane
from checkweigher_web.page import show_lane, show_shift
from checkweigher_web.shift import Shift
from checkweigher_web.technician.practice import Practice
from checkweigher_web.views.view import Look
from checkweigher_web.work.audit_view import Auditor
from checkweigher_web.work.bar import (
    hint_to_commissioning,
    keep_item,
    work_bar,
    work_menu,
    work_of,
)
from checkweigher_web.work.dialogs import Desk
from checkweigher_web.work.keeping import HELD, Keeper
from checkweigher_web.work.reports import add_reports
from checkweigher_web.work.services import Workshop

HUNG = 30.0  # time in s after which the process ends if the event loop hangs
_LOOK_PERIOD = 1.0  # s
_PATIENCE = 15.0  # maximum time in s to build the page of commissioning, which waits for nodes
_AWAY = 15.0  # time in s for which the server keeps the page of a browser that is offline
_LARGEST_MESSAGE = 1 << 20  # maximum size of a message from a browser in bytes
_REPORT = '/report'
# Content security policy of reports, which must not run scripts or load other files.
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'; sandbox"
)


def serve(
    site: Site,
    namespace: str | None = None,
    keep: Path | None = None,
    trust: Ed25519PublicKey | None = None,
) -> None:
    """Serve the page until SIGINT or SIGTERM.

    Parameters
    ----------
    site : Site
        Address, certificate and users. For port 0, the system chooses a free port.
    namespace : str, optional
        Namespace of the only lane to show, by default all lanes.
    keep : Path, optional
        Folder for the items that users keep. By default, users cannot keep items.
    trust : Ed25519PublicKey, optional
        Public key that verifies the seals of audit logs. By default, seals are not verified.

    Raises
    ------
    PageError, CertificateError, SettingsError, OutputError
        If the site cannot be served.
    """
    with _listen(site.checked()) as (listener, access, app), ExitStack() as stack:
        own = ['--ros-args', *enclave_arguments('', PAGE)]
        rclpy.init(args=[*sys.argv, *own], signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.try_shutdown)
        spinner = Spinner()
        stack.callback(spinner.stop)
        watch = Watch(spinner, namespace, SHOWN if keep is None else HELD)
        stack.callback(watch.close)
        workshop = Workshop(spinner)
        add_reports(app, workshop, REPORT_POLICY)
        _add_pages(access, watch, workshop, keep, Auditor(trust))
        _run(app, access, listener)


def serve_shift(site: Site, shift: Shift, report: Path | None = None) -> None:
    """Serve the page of a recorded shift until SIGINT or SIGTERM.

    Parameters
    ----------
    site : Site
        Address, certificate and users. For port 0, the system chooses a free port.
    shift : Shift
        Shift to show, which is weighed while the page is served.
    report : Path, optional
        HTML report of the command `evaluate`, to which the page links.

    Raises
    ------
    PageError, CertificateError, SettingsError, OutputError
        If the site cannot be served.
    OSError
        If the report cannot be read.
    """
    with _listen(site.checked()) as (listener, access, app):
        drawing = Drawing(shift)
        if report is not None:
            headers = {'Content-Security-Policy': REPORT_POLICY}
            answer = HTMLResponse(report.read_bytes(), headers=headers)
            app.add_api_route(_REPORT, lambda: answer, methods=['GET'])

        @ui.page('/', title='Checkweigher')
        async def show() -> None:
            say = page_language()
            header(access, _title('', say), say)
            show_shift(shift, drawing, say, _REPORT if report is not None else '')

        shift.start()
        _run(app, access, listener)


@contextmanager
def _listen(site: Site) -> Iterator[tuple[socket.socket, Access, FastAPI]]:
    """Listen at the address of a site, and yield the socket, its `Access` and the application."""
    with _listener(site) as listener:
        access = Access(replace(site, port=listener.getsockname()[1]))
        app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        add_login(app, access, STYLE)
        yield listener, access, app


def _listener(site: Site) -> socket.socket:
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


def _add_pages(
    access: Access, watch: Watch, workshop: Workshop, keep: Path | None, auditor: Auditor
) -> None:
    keeper = None if keep is None else Keeper(keep)
    viewers: Counter[str] = Counter()
    watch.viewers = lambda name: viewers[name]
    drawings: dict[str, Drawing] = {}
    lanes = Overview(watch)

    @ui.page('/', title='Checkweigher')
    async def overview() -> None:
        if (only := lanes.only()) is not None:
            show(only)
        else:
            say = page_language()
            header(access, _title('', say), say)
            show_overview(lanes, say)

    @ui.page('/lane/{name:path}', title='Checkweigher')
    async def lane(name: str) -> None:
        if name in watch.lanes:
            show(name)
        else:
            _wait(access, watch, name)

    @ui.page('/commissioning/{name:path}', title='Checkweigher', response_timeout=_PATIENCE)
    async def commission(name: str) -> None:
        if name not in watch.lanes:
            _wait(access, watch, name)
            return
        look, desk = look_at(name)
        if desk.role < Role.TECHNICIAN:
            ui.navigate.to(LOGIN)
            return
        services = await desk.begin()
        menu, back = partial(work_menu, desk, look), (Text('Back to the lane'), f'/lane/{name}')
        header(access, _title(name, look.say), look.say, look, lambda: True, menu, back)
        CommissioningPath(desk, services, look)

    def look_at(name: str) -> tuple[Look, Desk]:
        client = ui.context.client
        client.on_connect(lambda: viewers.update([name]))
        client.on_disconnect(lambda: viewers.subtract([name]))
        drawing = drawings.setdefault(name, Drawing(watch.lanes[name]))
        look = Look(drawing, watch.board, say=page_language())
        desk = Desk(access, watch.lanes[name], partial(workshop.of, name), auditor, look.say)
        look.work = work_of(desk)
        look.practice = Practice(desk) if desk.role >= Role.TECHNICIAN else None
        return look, desk

    def show(name: str) -> None:
        look, desk = look_at(name)
        menu = partial(work_menu, desk, look)
        header(access, _title(name, look.say), look.say, look, lambda: lanes.only() is None, menu)
        hint_to_users(access, look.say)
        hint_to_commissioning(desk)
        if look.work:
            work_bar(look)
            if keeper is not None:
                look.keep = partial(keep_item, desk, keeper)
        show_lane(look)


def _wait(access: Access, watch: Watch, name: str) -> None:
    """Show that a lane does not run, and load its page as soon as the lane runs."""
    say = page_language()
    header(access, _title(name, say), say, others=lambda: True)
    wait_for_lane(name, lambda: name in watch.lanes, say)


def _title(lane: str, say: Language) -> str:
    return say('lane {name}', name=lane) if lane else say('Checkweigher')


def _run(app: FastAPI, access: Access, listener: socket.socket) -> None:
    site = access.site
    ui.run_with(
        app,
        title='Checkweigher',
        tailwind=False,
        language='en-US',
        show_welcome_message=False,
        reconnect_timeout=_AWAY,
    )
    bind_events(access)
    log_in_lines()
    # The process ends unless the event loop calls `alive` again within `HUNG` s.
    alive = partial(faulthandler.dump_traceback_later, HUNG, exit=True)
    for look in (access.expel, forget_waiting, alive):
        nicegui.timer(_LOOK_PERIOD, look)
    # Print the address last, because a program that reads the address may then stop the server.
    code = access.first_code
    first = f'; {first_user(code)}' if code else ''
    nicegui.on_startup(lambda: print(f'page: {site.address}{first}', file=sys.stderr, flush=True))
    config = uvicorn.Config(
        Guard(app, access),
        http=PromptProtocol,
        log_config=None,
        access_log=False,
        timeout_graceful_shutdown=2,
        server_header=False,
        ssl_certfile=site.certificate,
        ssl_keyfile=site.key,
        ws_max_size=_LARGEST_MESSAGE,
        ws_per_message_deflate=False,  # Compression would take most of the processor time.
        # Trust X-Forwarded-For only behind a reverse proxy, because otherwise a client could forge
        # its address.
        proxy_headers=bool(site.origin),
    )
    uvicorn.Server(config).run(sockets=[listener])


def main() -> None:
    """Serve the page of all lanes with the options of the command line.

    If the page cannot be served, the reason is printed, and the process exits with status 2.
    """
    end_with_parent()
    parser = argparse.ArgumentParser()
    parser.add_argument('--host', default=ADDRESS)
    parser.add_argument('--certificate', type=Path)
    parser.add_argument('--key', type=Path)
    try:
        serve(Site(**vars(parser.parse_args(remove_ros_args(sys.argv)[1:]))))
    except KeyboardInterrupt:  # uvicorn raises SIGINT again after a regular end.
        pass
    except ValueError as error:
        print(f'checkweigher: {error}', file=sys.stderr)
        raise SystemExit(2) from None
