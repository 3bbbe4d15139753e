# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialogs that ask before something is done, and tell in words what came of it."""

from collections.abc import Awaitable, Callable

from nicegui import ui
from nicegui.element import Element

from checkweigher_core.printable import one_line
from checkweigher_web.access.guard import Access
from checkweigher_web.access.users import Role
from checkweigher_web.audit_view import Auditor
from checkweigher_web.lane import Lane
from checkweigher_web.work.services import LaneServices, Outcome, Person, RefusedError

Action = Callable[[], Awaitable[str]]


class Desk:
    """What the person at one browser does on one lane.

    `services` gives those of the lane, made when they are needed first; `auditor` reads its audit
    log.
    """

    def __init__(
        self, access: Access, lane: Lane, services: Callable[[], Awaitable[LaneServices]],
        auditor: Auditor | None = None,
    ) -> None:  # fmt: skip
        self.lane = lane
        self.services = services
        self.auditor = auditor or Auditor()
        self.needs_reason = False  # by the recipe on the line
        self._access = access
        self._client = ui.context.client

    @property
    def role(self) -> Role:
        """Role of the person now; a session may have ended."""
        session = self._access.session_of(self._client)
        return Role.VIEWER if session is None else session.user.role

    async def perform(self, role: Role, what: str, reason: str, action: Action) -> Outcome:
        """Do something, if the role of the person allows it; see `LaneServices.act`."""
        session = self._access.session_of(self._client)
        if session is None or session.user.role < role:
            return Outcome(False, f'this needs a login as {role.name.lower()}')
        reason = one_line(reason.strip(), 200)
        if self.needs_reason and not reason:
            return Outcome(False, 'the recipe on the line asks for a reason')
        person = Person(session.user.name, session.address)
        return await (await self.services()).act(person, what, reason, action)


class Dialog:
    """A dialog with a title, a body that the caller fills, a line of results, and buttons.

    A `wide` one has room for a table.
    """

    def __init__(self, title: str, *, wide: bool = False) -> None:
        self._dialog = ui.dialog().props(f'persistent aria-label="{title}"')
        self._dialog.on('hide', self._dialog.delete)
        with self._dialog, ui.element('div').classes(f'panel dialog{" wide" if wide else ""}'):
            ui.html(f'<h2>{title}</h2>', sanitize=False)
            self.body = ui.element('div').classes('fields')
            self._result = ui.label('').classes('result').props('role=status')
            self.buttons = ui.element('div').classes('buttons')
            with self.buttons:
                self.closing = ui.button('Cancel', on_click=self._dialog.close)
            self.closing.props('outline no-caps')
        self._dialog.open()

    def button(self, text: str, click: Callable[[], Awaitable[object]]) -> ui.button:
        """Add a button, which is busy while its work is done; a refusal is shown."""

        async def work() -> None:
            button.props('loading')
            self.closing.disable()
            try:
                await click()
            except RefusedError as error:
                self.tell(Outcome(False, str(error)))
            finally:
                button.props(remove='loading')
                self.closing.enable()

        with self.buttons:
            button = ui.button(text, on_click=work).props('no-caps')
        return button

    async def perform(
        self, desk: Desk, role: Role, what: str, reason: ui.input, action: Action
    ) -> bool:
        """Perform an action at a desk, show the outcome, and return whether it was done."""
        outcome = await desk.perform(role, what, str(reason.value or ''), action)
        self.tell(outcome)
        return outcome.done

    def tell(self, outcome: Outcome) -> None:
        """Show what came of an action."""
        sign = '✓' if outcome.done else '✗ not done:'
        self._result.set_text(f'{sign} {outcome.text}')
        self._result.classes(replace=f'result level-{"OK" if outcome.done else "ERROR"}')
        self.closing.set_text('Close')


def reason_field(desk: Desk) -> ui.input:
    """Add the field for the reason of a change."""
    return field('Reason' if desk.needs_reason else 'Reason (may be empty)')


def field(label: str, value: str = '', unit: str = '') -> ui.input:
    """Add a field for a text or a number."""
    found = ui.input(label, value=value).props('outlined dense maxlength=200')
    return found.props(f'suffix="{unit}"') if unit else found


def number(given: ui.input, *, empty: float | None = None) -> float:
    """Return the number in a field, in its unit; `RefusedError` for a text that is none."""
    text = str(given.value or '').strip().replace(',', '.')
    if not text and empty is not None:
        return empty
    try:
        return float(text)
    except ValueError:
        label = given.props['label']
        raise RefusedError(f'{label}: {one_line(text)!r} is not a number') from None


def ask(
    desk: Desk, role: Role, title: str, text: str, verb: str,
    plan: Callable[[], tuple[str, Action]], fields: Callable[[], object] = lambda: None,
) -> Element:  # fmt: skip
    """Ask before something is done.

    `fields` adds what has to be filled in; `plan` returns what will be done, in words for the
    audit log, and the action, or raises `RefusedError` for a field that cannot be used.
    """
    dialog = Dialog(title)
    with dialog.body:
        ui.label(text)
        fields()
        reason = reason_field(desk)

    async def act() -> None:
        what, action = plan()
        button.set_visibility(not await dialog.perform(desk, role, what, reason, action))

    button = dialog.button(verb, act)
    return dialog.body
