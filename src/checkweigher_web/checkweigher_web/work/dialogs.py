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
from checkweigher_web.elements import named, show_told
from checkweigher_web.lane import Deed, Lane
from checkweigher_web.languages.language import Language, Text
from checkweigher_web.languages.wording import from_node
from checkweigher_web.work import actions
from checkweigher_web.work.audit_view import Auditor
from checkweigher_web.work.services import ActionRefusedError, LaneServices, Outcome, Person

_NUMBER = re.compile(r'[-+]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)(e[-+]?[0-9]+)?', re.IGNORECASE)
# Numbers in which the comma or point may be a thousands separator or a decimal mark, such as 1,250.
# A number of this form is accepted only if its comma or point is the decimal mark of the language.
_THOUSANDS = re.compile(r'[-+]?[1-9][0-9]{0,2}([.,])[0-9]{3}')
Action = Callable[[], Awaitable[str]]


_NEEDS_LOGIN = {
    Role.OPERATOR: Text('this needs a login as operator'),
    Role.TECHNICIAN: Text('this needs a login as technician'),
}


class Desk:
    """Access of one user to a lane, with the role, the actions and the signatures of the user.

    `services` returns the services of the lane, and `auditor` reads its audit log. `say` is the
    language of the user.
    """

    def __init__(
        self,
        access: Access,
        lane: Lane,
        services: Callable[[], Awaitable[LaneServices]],
        auditor: Auditor,
        say: Language,
    ) -> None:
        self.lane = lane
        self.say = say
        self.services = services
        self.auditor = auditor
        self.users = access.users
        self.needs_reason = False  # whether the recipe in use requires a reason for each action
        self._access = access
        self._client = ui.context.client

    @property
    def role(self) -> Role:
        """Present role of the user, or VIEWER after the end of the session."""
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
        """Perform an action if the user has at least `role`, and write entries to the audit log.

        `what` is the name of the action in the audit log, and `reason` is the user's reason.
        Returns the outcome. The action is refused, without an entry, if the role is too low or a
        required reason is missing.
        """
        session = self._access.session_of(self._client)
        if session is None or session.user.role < role:
            return Outcome(False, _NEEDS_LOGIN[role])
        reason = one_line(reason.strip(), 200)
        if self.needs_reason and not reason:
            return Outcome(False, Text('the recipe on the line asks for a reason'))
        person = Person(session.user.name, session.address)
        outcome = await (await self.services()).act(person, what, reason, action)
        if outcome.done:
            self.lane.take(Deed(time.time_ns(), person.name, what))
        return outcome

    async def sign(self, what: Signable, meaning: str, password: str) -> Signature:
        """Sign a record for the user, after the user has entered the password again.

        Returns the signature. After wrong passwords, the user must wait, as after failed logins.
        Raises `ActionRefusedError` if the session has ended, if the user must wait, or if the
        signature is refused. Raises the errors of `signing_key` if the users file cannot be used.
        """
        session, throttle = self._access.session_of(self._client), self._access.throttle
        if session is None:
            raise ActionRefusedError(Text('this needs a login'))
        user, keys = session.user, keys_of(session.user.name, session.address)
        if wait := throttle.wait(*keys):
            seconds = round(wait + 1)
            text = Text('too many failed attempts: try again in {seconds} s', seconds=seconds)
            raise ActionRefusedError(text)
        arguments = self._access.users.path, user, password, what, meaning
        try:
            made = await asyncio.to_thread(sign_by, *arguments)
        except SigningError as error:
            if isinstance(error, WrongPasswordError):
                throttle.fail(*keys)
            raise ActionRefusedError(str(error)) from None
        throttle.forget(*keys)
        return made


_CLOSE = Text('Close')


class Dialog:
    """Dialog with a title, a body for the fields of the caller, a line for results, and buttons.

    Titles are English texts, which the dialog translates. A `wide` dialog has room for a table.
    """

    def __init__(
        self, title: str, say: Language, closing: str = _CLOSE, *, wide: bool = False
    ) -> None:
        self.say, title = say, say(title)
        self._dialog = named(ui.dialog().props('persistent'), title)
        self._dialog.on('hide', self._dialog.delete)
        with self._dialog, ui.element('div').classes(f'panel dialog{" wide" if wide else ""}'):
            ui.html(f'<h2>{title}</h2>', sanitize=False)
            self.body = ui.element('div').classes('fields')
            self._result = ui.label('').classes('result').props('role=status')
            self._buttons = ui.element('div').classes('buttons')
            with self._buttons:
                self._closing = ui.button(say(closing), on_click=self._dialog.close)
            self._closing.props('outline no-caps')
        self._dialog.open()

    def button(self, text: str, click: Callable[[], Awaitable[object]]) -> ui.button:
        """Add a button that calls `click`, and return it.

        If `click` raises `ActionRefusedError`, the dialog shows the reason.
        """

        async def work() -> None:
            button.props('loading')
            self._closing.disable()
            try:
                await click()
            except ActionRefusedError as error:
                self.tell(Outcome(False, error.text))
            finally:
                button.props(remove='loading')
                self._closing.enable()

        with self._buttons:
            button = ui.button(self.say(text), on_click=work).props('no-caps')
        return button

    def tell(self, outcome: Outcome) -> None:
        """Show the outcome of an action, and change the label of the closing button to Close."""
        show_outcome(self._result, outcome, self.say)
        self._closing.set_text(self.say(_CLOSE))


def show_outcome(label: ui.label, outcome: Outcome, say: Language) -> None:
    """Show the outcome of an action in a label.

    The label begins with a tick if the action was done, otherwise with a cross. The label is empty
    if the action was done and needs no text, because the page itself shows what it has changed.
    """
    if outcome.done and not outcome.text:
        label.set_text('')
        return
    show_told(label, from_node(outcome.text), say)
    text = label.text
    label.set_text(f'✓ {text}' if outcome.done else say('✗ not done: {text}', text=text))
    label.classes(replace=f'result level-{"OK" if outcome.done else "ERROR"}')


def reason_field(desk: Desk) -> ui.input:
    """Add a field for the reason of an action, and return it."""
    return field(desk.say('Reason') if desk.needs_reason else desk.say('Reason (may be empty)'))


def field(label: str, value: str = '', unit: str = '') -> ui.input:
    """Add a field for a text or for a number with a unit, and return it."""
    found = ui.input(label, value=value).props('outlined dense maxlength=200')
    # With `stack-label`, the label is above the text, so that an empty field shows its unit, too.
    return found.props(f'suffix="{unit}" stack-label') if unit else found


def number_in(given: ui.input, say: Language, *, empty: float | None = None) -> float:
    """Return the number in a field, or `empty` if the field is empty.

    Raises `ActionRefusedError` if the text is missing, not a number, or ambiguous in the language
    of the user.
    """
    text = str(given.value or '').strip()
    if not text and empty is not None:
        return empty
    label = given.props['label']
    if not _NUMBER.fullmatch(text):
        shown = repr(one_line(text))
        raise ActionRefusedError(Text('{label}: {text} is not a number', label=label, text=shown))
    if (found := _THOUSANDS.fullmatch(text)) and found[1] != say.point:
        decimal, whole = text.replace(found[1], say.point), text.replace(found[1], '')
        raise ActionRefusedError(
            Text(
                '{label}: {text} may be {decimal} or {whole}: write one of these',
                label=label,
                text=text,
                decimal=decimal,
                whole=whole,
            )
        )
    return float(text.replace(',', '.'))


def mass_in(given: ui.input, say: Language, *, empty: float | None = None) -> float:
    """Return the mass in kg from a field in the unit of the user.

    `empty` is in the unit of the user, too. Raises `ActionRefusedError` if the text is missing, not
    a number, or ambiguous in the language of the user.
    """
    return round(number_in(given, say, empty=empty) / say.per_kg, 9)


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

    `title`, `text`, and the label `verb` of the button are English texts. Each function in `fields`
    adds a field and returns its element. `plan` is called with the elements when the user
    confirms. `plan` returns the name of the action in the audit log and the action, or raises
    `ActionRefusedError` if a field is not valid. `role` is the lowest role that may confirm.
    """
    dialog = Dialog(title, desk.say, Text('Cancel'))
    with dialog.body:
        ui.label(desk.say(text))
        given = [add() for add in fields]
        reason = reason_field(desk)

    async def act() -> None:
        outcome = await desk.perform(role, *plan(*given), str(reason.value or ''))
        dialog.tell(outcome)
        button.set_visibility(not outcome.done)

    button = dialog.button(verb, act)
    return dialog.body
