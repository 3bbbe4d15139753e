# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialogs that ask for confirmation of an action and show its outcome."""

import asyncio
from collections.abc import Awaitable, Callable
import re
import time

from nicegui import ui
from nicegui.element import Element

from checkweigher_core.printable import one_line
from checkweigher_validation.batch.signatures import Signature
from checkweigher_validation.batch.signing import Signable, SigningError
from checkweigher_web.access.guard import Access
from checkweigher_web.access.throttle import keys_of
from checkweigher_web.access.users import Role, WrongPasswordError, sign_by
from checkweigher_web.lane import Deed, Lane
from checkweigher_web.work import actions
from checkweigher_web.work.audit_view import Auditor
from checkweigher_web.work.services import ActionRefusedError, LaneServices, Outcome, Person

_NUMBER = re.compile(r'[-+]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)(e[-+]?[0-9]+)?', re.IGNORECASE)
# Numbers in which the comma may be a thousands separator or a decimal mark.
_THOUSANDS = re.compile(r'[-+]?[1-9][0-9]{0,2},[0-9]{3}')
Action = Callable[[], Awaitable[str]]


class Desk:
    """Access of one user to a lane.

    `services` returns the services of the lane, and `auditor` reads its audit log.
    """

    def __init__(
        self,
        access: Access,
        lane: Lane,
        services: Callable[[], Awaitable[LaneServices]],
        auditor: Auditor,
    ) -> None:
        self.lane = lane
        self.services = services
        self.auditor = auditor
        self.users = access.users
        self.needs_reason = False  # whether the recipe in use requires a reason for each action
        self._access = access
        self._client = ui.context.client

    @property
    def role(self) -> Role:
        """Present role of the user, which is VIEWER after the end of the session."""
        return self._access.role_of(self._client) or Role.VIEWER

    @property
    def person(self) -> str:
        """Name of the user, or '' after the end of the session."""
        session = self._access.session_of(self._client)
        return '' if session is None else session.user.name

    async def begin(self) -> LaneServices:
        """Return the services of the lane, and update `needs_reason`."""
        services = await self.services()
        try:
            known = await actions.products(services)
            product = known.get(self.lane.statistics.product) if self.lane.statistics else None
            self.needs_reason = product is not None and product.reason
        except ActionRefusedError:
            self.needs_reason = False
        return services

    async def perform(self, role: Role, what: str, action: Action, reason: str) -> Outcome:
        """Perform an action with audit log entries if the role of the user allows it."""
        session = self._access.session_of(self._client)
        if session is None or session.user.role < role:
            return Outcome(False, f'this needs a login as {role.name.lower()}')
        reason = one_line(reason.strip(), 200)
        if self.needs_reason and not reason:
            return Outcome(False, 'the recipe on the line asks for a reason')
        person = Person(session.user.name, session.address)
        outcome = await (await self.services()).act(person, what, reason, action)
        if outcome.done:
            self.lane.take(Deed(time.time_ns(), person.name, what))
        return outcome

    async def sign(self, what: Signable, meaning: str, password: str) -> Signature:
        """Return the signature of the user, who has entered the password again.

        Raises `ActionRefusedError` if the user may not sign. After wrong passwords, the user must
        wait as at the login.
        """
        session, throttle = self._access.session_of(self._client), self._access.throttle
        if session is None:
            raise ActionRefusedError('this needs a login')
        user, keys = session.user, keys_of(session.user.name, session.address)
        if wait := throttle.wait(*keys):
            raise ActionRefusedError(f'too many failed attempts: try again in {wait + 1:.0f} s')
        arguments = self._access.users.path, user, password, what, meaning
        try:
            made = await asyncio.to_thread(sign_by, *arguments)
        except SigningError as error:
            if isinstance(error, WrongPasswordError):
                throttle.fail(*keys)
            raise ActionRefusedError(str(error)) from None
        throttle.forget(*keys)
        return made


class Dialog:
    """Dialog with a title, a body for the fields of the caller, a line for results, and buttons.

    A `wide` dialog has room for a table.
    """

    def __init__(self, title: str, closing: str = 'Close', *, wide: bool = False) -> None:
        self._dialog = ui.dialog().props(f'persistent aria-label="{title}"')
        self._dialog.on('hide', self._dialog.delete)
        with self._dialog, ui.element('div').classes(f'panel dialog{" wide" if wide else ""}'):
            ui.html(f'<h2>{title}</h2>', sanitize=False)
            self.body = ui.element('div').classes('fields')
            self._result = ui.label('').classes('result').props('role=status')
            self._buttons = ui.element('div').classes('buttons')
            with self._buttons:
                self._closing = ui.button(closing, on_click=self._dialog.close)
            self._closing.props('outline no-caps')
        self._dialog.open()

    def button(self, text: str, click: Callable[[], Awaitable[object]]) -> ui.button:
        """Add a button that calls `click`, and shows the reason if the action is refused."""

        async def work() -> None:
            button.props('loading')
            self._closing.disable()
            try:
                await click()
            except ActionRefusedError as error:
                self.tell(Outcome(False, str(error)))
            finally:
                button.props(remove='loading')
                self._closing.enable()

        with self._buttons:
            button = ui.button(text, on_click=work).props('no-caps')
        return button

    def tell(self, outcome: Outcome) -> None:
        """Show the outcome of an action."""
        show_outcome(self._result, outcome)
        self._closing.set_text('Close')


def show_outcome(label: ui.label, outcome: Outcome) -> None:
    """Show the outcome of an action in a label."""
    label.set_text(outcome.line)
    label.classes(replace=f'result level-{"OK" if outcome.done else "ERROR"}')


def reason_field(desk: Desk) -> ui.input:
    """Add a field for the reason of an action."""
    return field('Reason' if desk.needs_reason else 'Reason (may be empty)')


def field(label: str, value: str = '', unit: str = '') -> ui.input:
    """Add a field for a text or a number."""
    found = ui.input(label, value=value).props('outlined dense maxlength=200')
    # The browser shows the unit of an empty field only if its label stands above the text.
    return found.props(f'suffix="{unit}" stack-label') if unit else found


def number_in(given: ui.input, *, empty: float | None = None) -> float:
    """Return the number in a field, or `empty` if the field is empty.

    Raises `ActionRefusedError` if the number is missing or ambiguous.
    """
    text = str(given.value or '').strip()
    if not text and empty is not None:
        return empty
    if not _NUMBER.fullmatch(text):
        raise ActionRefusedError(f'{given.props["label"]}: {one_line(text)!r} is not a number')
    if _THOUSANDS.fullmatch(text):
        raise ActionRefusedError(
            f'{given.props["label"]}: {text} may be {text.replace(",", ".")} or '
            f'{text.replace(",", "")}: write one of these'
        )
    return float(text.replace(',', '.'))


def ask(
    desk: Desk,
    title: str,
    text: str,
    verb: str,
    plan: Callable[..., tuple[str, Action]],
    *fields: Callable[[], Element],
    role: Role = Role.OPERATOR,
) -> Element:
    """Open a dialog that asks for confirmation of an action, and return the body of the dialog.

    Each function in `fields` adds a field and returns its element. The function `plan` gets these
    elements. `plan` returns the name of the action in the audit log and the action, or raises
    `ActionRefusedError` if a field is not valid. `role` is the lowest role that may confirm.
    """
    dialog = Dialog(title, 'Cancel')
    with dialog.body:
        ui.label(text)
        given = [add() for add in fields]
        reason = reason_field(desk)

    async def act() -> None:
        outcome = await desk.perform(role, *plan(*given), str(reason.value or ''))
        dialog.tell(outcome)
        button.set_visibility(not outcome.done)

    button = dialog.button(verb, act)
    return dialog.body
