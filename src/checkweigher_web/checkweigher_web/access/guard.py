# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Guard of the page, which refuses requests without a login and requests from other sites."""

from collections.abc import Callable
from functools import partial
import secrets
from typing import Any
from urllib.parse import parse_qsl, urlencode

from fastapi import Response
from fastapi.responses import RedirectResponse
from nicegui import Client, core
from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from checkweigher_web.access.sessions import Session, Sessions
from checkweigher_web.access.site import Site
from checkweigher_web.access.throttle import Throttle
from checkweigher_web.access.users import Role, UserFile, default_users

# The content security policy allows unsafe-inline and unsafe-eval, because NiceGUI writes scripts
# and styles into its pages and compiles Vue templates in the browser. The policy forbids scripts in
# attributes of elements, files from other sites, connections and forms to other sites, and frames
# around a page.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "script-src-attr 'none'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "font-src 'self' data:; object-src 'none'; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'self'"
)
# Content security policy of pages without NiceGUI, such as the login form.
PLAIN_POLICY = (
    "default-src 'none'; style-src 'self'; img-src 'self'; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'self'"
)
HEADERS = {
    'X-Content-Type-Options': 'nosniff',
    'X-Frame-Options': 'DENY',
    # With `no-referrer`, browsers would send forms with `Origin: null`, which `Guard` refuses.
    'Referrer-Policy': 'same-origin',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Permissions-Policy': 'camera=(), geolocation=(), microphone=(), usb=(), serial=()',
}
LOGIN, LOGOUT, STYLE = '/login', '/logout', '/page.css'
_PUBLIC = (LOGIN, STYLE, '/favicon.ico')
_ASSETS, _SOCKET = '/_nicegui/', '/_nicegui_ws/'
# Key under which the ASGI scope of a request contains the session identifier.
_SESSION = 'checkweigher.session'
# Message of the RuntimeError that Starlette raises if the browser disconnects before the response.
_UNANSWERED = 'No response returned.'


class Access:
    """Users and sessions of a site, which determine the role of the viewer of each page."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.users = UserFile(site.users or default_users())
        self.sessions = Sessions(self.users, 60 * site.idle)
        self.throttle = Throttle()
        # Browsers send a cookie to all ports of a host, so the cookie name contains the port.
        self.cookie = f'{"__Host-" if site.secure else ""}checkweigher-{site.port}'
        self._first_code = secrets.token_hex(5)
        # Identifiers of the pages that could no longer be shown when `expel` was last called.
        self._ended: set[str] = set()

    @property
    def first_code(self) -> str:
        """Code that is required to add the first user, or '' if there are users.

        The code is shown only in the terminal or log in which the page was started.
        """
        return '' if self.users.now() else self._first_code

    def session_of(self, client: Client) -> Session | None:
        """Return the session of a page, or None if it has ended or never existed."""
        return self.sessions.find(_identifier(client))

    def role_of(self, client: Client) -> Role | None:
        """Return the present role of the user of a page, or None if the page must not be shown.

        A page that was loaded without a session has the role VIEWER if the site is open, and must
        not be shown otherwise. A page that was loaded with a session must not be shown after the
        end of the session.
        """
        if (session := self.session_of(client)) is not None:
            return session.user.role
        return Role.VIEWER if self.site.open and not _identifier(client) else None

    def expel(self) -> None:
        """Reload and delete the pages whose session had already ended at the previous call.

        The delay of one call lets a browser receive the response to its logout before the page is
        reloaded.
        """
        clients = list(Client.instances.values())
        ended = {client.id for client in clients if client.page.path and not self.role_of(client)}
        for client in clients:
            if client.id in ended & self._ended:
                client.run_javascript('location.reload()')
                core.loop.call_later(1.0, _delete, client)  # type: ignore[union-attr]
        self._ended = ended


def _delete(client: Client) -> None:
    if not client.is_deleted:
        client.delete()


def _identifier(client: Client) -> str:
    return str(client.request.scope.get(_SESSION, ''))


class Guard:
    """ASGI application that passes requests on to another application, or refuses them.

    A request needs a session unless the site is open or the requested file is public, such as the
    login form and the style sheets. A GET or HEAD request for a page is redirected to the login
    form if the request needs a session but has none.

    Requests for a host name that the site does not serve are refused, because another web site
    could point its own host name to this machine to read the data of the line. Requests that come
    from another web site are refused, because that site could otherwise open a socket to the page.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request or a socket on to the application, or refuse it."""
        if scope['type'] not in ('http', 'websocket'):
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        identifier = connection.cookies.get(self._access.cookie, '')
        if self._access.sessions.find(identifier, used=scope['type'] == 'http') is None:
            identifier = ''
        send = _with_headers(send, scope['path'], self._access.site)
        refusal = self._refusal(connection, identifier)
        if refusal is None:
            await self._pass_on(_bound(scope, identifier), receive, send)
        elif scope['type'] == 'websocket':
            await receive()
            await send({'type': 'websocket.close', 'code': 1008})  # uvicorn answers with 403.
        else:
            await refusal(scope, receive, send)

    async def _pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Call the application, and ignore errors that a disconnected browser causes."""
        try:
            await self._app(scope, receive, send)
        except ClientDisconnect:
            pass
        except RuntimeError as error:
            if str(error) != _UNANSWERED:
                raise

    def _foreign(self, connection: HTTPConnection, *, reads: bool) -> Response | None:
        """Return an error response to a request for another host or from another site, else None.

        `reads` is true for a GET or HEAD request.
        """
        site, host = self._access.site, connection.headers.get('host', '')
        if not site.serves(host):
            return Response('this page is not served by this name', 421)
        origin = connection.headers.get('origin')
        own = site.origin or f'{"https" if site.secure else "http"}://{host}'
        # Only a GET or HEAD request may lack the origin, because browsers send the origin with all
        # other requests.
        if origin != own and not (origin is None and reads):
            return Response('this request comes from another site', 403)
        return None

    def _refusal(self, connection: HTTPConnection, identifier: str) -> Response | None:
        reads = connection.scope.get('method') in ('GET', 'HEAD')
        foreign = self._foreign(connection, reads=reads)
        path = connection.scope['path']
        known = identifier or self._access.site.open or path in _PUBLIC or path.startswith(_ASSETS)
        if foreign is not None or known:
            return foreign
        if reads and not path.startswith(_SOCKET):
            return RedirectResponse(LOGIN, 303)
        return Response('log in first', 403)


def _bound(scope: Scope, identifier: str) -> Scope:
    """Return a copy of the scope of a request, with the identifier of its session.

    `identifier` is '' for a request without a session. If a socket names a page of another session,
    the page identifier in the scope is replaced by an invalid one. NiceGUI refuses a socket with an
    invalid page identifier, and the browser then reloads the page.
    """
    scope = {**scope, _SESSION: identifier}
    if scope['path'].startswith(_SOCKET):
        query = dict(parse_qsl(scope['query_string'].decode('latin-1')))
        client = Client.instances.get(query.get('client_id', ''))
        if client is None or _identifier(client) != identifier:
            query['client_id'] = 'of-another-session'
            scope['query_string'] = urlencode(query).encode('latin-1')
    return scope


def bind_events(access: Access) -> None:
    """Accept the events of a page only from the sockets of this page.

    By itself, NiceGUI accepts events from any socket that names the page. Events of the type
    `event`, such as clicks, count as use of the session.
    """
    handlers = core.sio.handlers['/']
    del handlers['log']  # The event `log` would let browsers write to the server log.
    for name in ('event', 'javascript_response', 'ack'):
        core.sio.on(name, partial(_handle, name, handlers[name], access))


def _handle(
    name: str,
    handler: Callable[[str, dict[str, Any]], None],
    access: Access,
    socket: str,
    message: object = None,
    *_: object,
) -> None:
    """Call the handler of an event if the socket belongs to the page that the message names.

    The event is ignored if the viewer may no longer see the page.
    """
    given = message if isinstance(message, dict) else {}
    client = Client.instances.get(str(given.get('client_id')))
    if client is None or client.id not in core.sio.rooms(socket):
        return
    if name == 'event':
        access.sessions.find(_identifier(client), used=True)
    if access.role_of(client) is not None:
        handler(socket, given)


def _with_headers(send: Send, path: str, site: Site) -> Send:
    async def send_guarded(message: Message) -> None:
        if message['type'] == 'http.response.start':
            headers = MutableHeaders(scope=message)
            headers.update(HEADERS)
            headers.setdefault('Content-Security-Policy', _POLICY)
            if not path.startswith(_ASSETS):
                headers['Cache-Control'] = 'no-store'
            # HSTS applies to all ports of a host. Do not send HSTS on localhost, because other
            # servers on localhost may lack TLS.
            if site.secure and not site.open:
                headers['Strict-Transport-Security'] = 'max-age=31536000'
        await send(message)

    return send_guarded
