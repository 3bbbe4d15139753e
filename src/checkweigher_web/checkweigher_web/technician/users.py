# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog in which a technician adds, changes and removes users of the page."""

from collections.abc import Callable
from functools import partial

from nicegui import json, ui

from checkweigher_web.access import users as accounts
from checkweigher_web.access.users import ROLES, Role
from checkweigher_web.elements import ItemList, scrolled
from checkweigher_web.languages.language import Text
from checkweigher_web.work import actions
from checkweigher_web.work.dialogs import Desk, Dialog, ask, field, reason_field
from checkweigher_web.work.services import ActionRefusedError, LaneServices

_HEADS = Text('name'), Text('role')
_TEXT = Text(
    'A viewer sees, an operator also works at the line, a technician also sets it up. A change '
    'ends the sessions of that user.'
)
_REMOVE = Text('The user may not log in any more.')
_OWN = Text('this is your own account: another technician has to do this')


async def users(desk: Desk, services: LaneServices) -> None:
    """Open a dialog with the users of the page."""
    UsersDialog(desk).show()


class UsersDialog(Dialog):
    """Dialog with a list of users, and a form to add, change or remove a user."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(Text('Users'), desk.say)
        say = desk.say
        self._desk, self._path = desk, desk.users.path
        with self.body:
            ui.label(say(_TEXT))
            with scrolled('choices', say('users')):
                self._list = ItemList(map(say, _HEADS), self._choose, say('change user'))
            self._name = field(say('Name'))
            roles = {role: say(role) for role in ROLES}
            self._role = ui.select(roles, label=say('Role')).props('outlined dense')
            self._password, self._again = (
                ui.input(label, password=True).props(
                    'outlined dense maxlength=200 autocomplete=new-password'
                )
                for label in (say('New password'), say('The same again'))
            )
            self._reason = reason_field(desk)
        self.button(Text('Remove'), self._remove)
        self.button(Text('Set password'), self._set_password)
        self.button(Text('Set role'), self._set_role)
        self.button(Text('Add'), self._add)

    def show(self) -> None:
        """Read the users file, and show its users."""
        known = self._desk.users.now().values()
        rows = [[user.name, user.name, '', self.say(user.role.name.lower())] for user in known]
        self._list.show_text(json.dumps(rows))

    def _choose(self, name: str) -> None:
        user = self._desk.users.find(name)
        self._list.choose(name)
        self._name.set_value(name)
        self._role.set_value(user.role.name.lower() if user else None)

    async def _add(self) -> None:
        name, role = self._given_name(), self._given_role()
        add = partial(accounts.add_user, self._path, name, role, self._given_password())
        await self._perform(
            Text('add user {name} as {role}', name=name, role=Text(role.name.lower())), add
        )

    async def _set_role(self) -> None:
        name, role = self._of_other(), self._given_role()
        change = partial(accounts.change_user, self._path, name, role=role)
        await self._perform(
            Text('user {name} becomes {role}', name=name, role=Text(role.name.lower())), change
        )

    async def _set_password(self) -> None:
        name = self._given_name()
        change = partial(accounts.change_user, self._path, name, password=self._given_password())
        await self._perform(Text('new password for user {name}', name=name), change)

    async def _remove(self) -> None:
        name = self._of_other()

        async def act() -> str:
            remove = partial(accounts.remove_user, self._path, name)
            said = await actions.change_file(remove, Text('done: removed'))
            self.show()
            return said

        what = Text('remove user {name}', name=name)
        title, verb = Text('Remove user'), Text('Remove')
        ask(self._desk, title, _REMOVE, verb, lambda: (what, act), role=Role.TECHNICIAN)

    async def _perform(self, what: Text, change: Callable[[], None]) -> None:
        reason = str(self._reason.value or '')
        act = partial(actions.change_file, change, Text('done: {what}', what=what))
        self.tell(await self._desk.perform(Role.TECHNICIAN, what, act, reason))
        self._password.set_value('')
        self._again.set_value('')
        self.show()

    def _given_name(self) -> str:
        name = str(self._name.value or '').strip()
        if not name:
            raise ActionRefusedError(Text('Name: choose a user or give a name'))
        return accounts.account_name(name)

    def _of_other(self) -> str:
        if (name := self._given_name()) == self._desk.person:
            raise ActionRefusedError(_OWN)
        return name

    def _given_role(self) -> Role:
        if not self._role.value:
            raise ActionRefusedError(Text('Role: choose one'))
        return Role[str(self._role.value).upper()]

    def _given_password(self) -> str:
        if self._password.value != self._again.value:
            raise ActionRefusedError(Text('the two passwords differ'))
        return str(self._password.value or '')
