# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Login and logout by two HTML forms that work without JavaScript."""

import asyncio
from html import escape
from pathlib import Path
import secrets
import sys
from typing import Any
from urllib.parse import parse_qs

from fastapi import FastAPI, Request, Response
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse
from rclpy.logging import get_logger

from checkweigher_core.printable import one_line
from checkweigher_web.access.guard import LOGIN, LOGOUT, PLAIN_POLICY, STYLE, Access
from checkweigher_web.access.throttle import keys_of
from checkweigher_web.access.users import NOBODY, SHORTEST, User, account_name, add_first_user
from checkweigher_web.languages.language import Language, Text, language_of

_LARGEST = 4096  # maximum size of a form in bytes
_PAGE = """<!doctype html>
<html lang="{lang}">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title><link rel="stylesheet" href="{style}"></head>
<body><main class="login"><h1>{heading}</h1>
<p role="alert" class="level-ERROR">{said}</p>
<form method="post" action="{login}" autocomplete="on">
<input type="hidden" name="token" value="{token}">{first}
<label>{name} <input name="name" autocomplete="username" required {focus}></label>
<label>{password} <input name="password" type="password" autocomplete="{kind}-password" required>
</label>
<button>{button}</button>
</form>{look}</main></body></html>
"""
_FIRST = """
<p>{text}</p>
<label>{code} <input name="code" autocomplete="off" autofocus required></label>"""
_NO_USER = Text(
    'The page has no user yet. The first one is a technician, who may do everything. The terminal '
    'or log in which the page was started shows the code now.'
)
_NEW_PASSWORD = Text('Password, {shortest} characters or more', shortest=SHORTEST)


def first_user(code: str) -> str:
    """Return the line with the code for the first user, which the server prints in the terminal."""
    return f'no user yet: log in with the code {code} to make the first one'


def logout_form(token: str, say: Language) -> str:
    """Return the logout form as HTML. `token` is the token of the session that the form ends."""
    label = escape(say('Log out'))
    return (
        f'<form method="post" action="{LOGOUT}"><input type="hidden" name="token" '
        f'value="{escape(token)}"><button>{label}</button></form>'
    )


def add_login(app: FastAPI, access: Access, style: Path) -> None:
    """Add the routes of the login, the logout and their style sheet to an application."""
    forms = _Forms(access)
    app.add_api_route(STYLE, lambda: FileResponse(style, media_type='text/css'), methods=['GET'])
    app.add_api_route(LOGIN, forms.show, methods=['GET'])
    app.add_api_route(LOGIN, forms.log_in, methods=['POST'])
    app.add_api_route(LOGOUT, forms.log_out, methods=['POST'])


class _Forms:
    """Handlers of the login and logout forms."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self._log = get_logger('page')
        self._turn = asyncio.Lock()  # one password check at a time, because a check takes 64 MiB
        self._form_cookie = f'{access.cookie}-form'
        self._cookie: dict[str, Any] = {
            'httponly': True,
            'samesite': 'strict',
            'secure': access.site.secure,
        }

    def show(self, request: Request) -> Response:
        """Return the login form."""
        return self.form(request, '')

    def form(self, request: Request, said: str, status: int = 200) -> Response:
        """Return the login form with the message `said`, a token, and the HTTP status `status`.

        The browser must return the token in the form and as a cookie, so that no other web site can
        send the form. While there are no users, the form also asks for the code for the first user,
        which is printed again in the terminal.
        """
        token = secrets.token_urlsafe(32)
        say = language_of(request.headers, request.cookies)
        text = escape(say('Look without a login'))
        link = f'<p><a href="/">{text}</a></p>'
        # Print the code again, because the line printed at startup may have scrolled away.
        if code := self._access.first_code:
            print(f'page: {first_user(code)}', file=sys.stderr, flush=True)
        first = _FIRST.format(text=escape(say(_NO_USER)), code=escape(say('Code')))
        page = _PAGE.format(
            style=STYLE,
            login=LOGIN,
            lang=say.tag,
            title=escape(say('Checkweigher: log in')),
            heading=escape(say('Checkweigher')),
            name=escape(say('Name')),
            password=escape(say(_NEW_PASSWORD if code else Text('Password'))),
            said=escape(say(said)),
            token=token,
            first=first if code else '',
            focus='' if code else 'autofocus',
            kind='new' if code else 'current',
            button=escape(say('Make the user') if code else say('Log in')),
            look=link if self._access.site.open else '',
        )
        answer = HTMLResponse(page, status, {'Content-Security-Policy': PLAIN_POLICY})
        answer.set_cookie(self._form_cookie, token, **self._cookie)
        return answer

    async def log_in(self, request: Request) -> Response:
        """Log a user in and redirect to the page, or return the form with the reason for a refusal.

        If the form contains the code for the first user, this user is added before the login.
        """
        given = await _fields(request)
        if not _same(given.get('token', ''), request.cookies.get(self._form_cookie, '')):
            text = Text('This form was too old or not of this page: try again.')
            return self.form(request, text, 403)
        async with self._turn:
            return await self._decide(request, given)

    async def _decide(self, request: Request, given: dict[str, str]) -> Response:
        name = account_name(given.get('name', ''))
        address = _address(request)
        throttle, keys = self._access.throttle, keys_of(name, address)
        who = f'login of {one_line(name)!r} from {address}'
        if wait := throttle.wait(*keys):
            # Log refused logins at most once per second, because repeated attempts could otherwise
            # fill the log.
            self._log.warning(
                f'{who}: refused, {wait:.0f} s too soon after failures', throttle_duration_sec=1.0
            )
            seconds = round(wait + 1)
            text = Text('Too many failed attempts: try again in {seconds} s.', seconds=seconds)
            answer = self.form(request, text, 429)
            answer.headers['Retry-After'] = str(seconds)
            return answer
        if 'code' in given:
            user, refusal = await self._first_user(name, given)
        else:
            user, refusal = self._access.users.find(name), Text('Name or password are wrong.')
            right = (user or NOBODY).has_password
            user = user if await asyncio.to_thread(right, given.get('password', '')) else None
        if user is None:
            throttle.fail(*keys)
            self._log.warning(f'{who}: failed')
            return self.form(request, refusal, 403)
        throttle.forget(*keys)
        self._log.info(f'{who}: {user.role.name.lower()}')
        self._access.sessions.end(request.cookies.get(self._access.cookie, ''))
        answer = RedirectResponse('/', 303)
        session = self._access.sessions.begin(user, address)
        answer.set_cookie(self._access.cookie, session, **self._cookie)
        answer.delete_cookie(self._form_cookie, **self._cookie)
        return answer

    async def _first_user(self, name: str, given: dict[str, str]) -> tuple[User | None, str]:
        """Add and return the first user, or return None and the reason for the refusal."""
        if not _same(given['code'].strip().lower(), self._access.first_code):
            return None, Text('The code is wrong: the page shows it where it was started.')
        path, password = self._access.users.path, given.get('password', '')
        try:
            user = await asyncio.to_thread(add_first_user, path, name, password)
        except ValueError as error:
            return None, f'{error}.'
        return user, ''

    async def log_out(self, request: Request) -> Response:
        """End the session, and redirect to the login form.

        If the logout form lacks the token of the session, returns an error response and does not
        end the session.
        """
        identifier = request.cookies.get(self._access.cookie, '')
        session, given = self._access.sessions.find(identifier), await _fields(request)
        if session is not None:
            if not _same(given.get('token', ''), session.token):
                return Response('this form is not of this page', 403)
            self._access.sessions.end(identifier)
            self._log.info(f'logout of {session.user.name!r} from {_address(request)}')
        answer = RedirectResponse(LOGIN, 303)
        answer.delete_cookie(self._access.cookie, **self._cookie)
        return answer


async def _fields(request: Request) -> dict[str, str]:
    """Return the fields of a form by name, or an empty dict if the form is too large."""
    body = b''
    async for part in request.stream():
        body += part
        if len(body) > _LARGEST:
            return {}
    found = parse_qs(body.decode('utf-8', errors='replace'))
    return {name: values[0] for name, values in found.items()}


def _same(given: str, known: str) -> bool:
    return bool(known) and secrets.compare_digest(given.encode(), known.encode())


def _address(request: Request) -> str:
    return request.client.host if request.client else '?'
