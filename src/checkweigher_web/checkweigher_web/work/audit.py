# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog with the audit log of a lane: the state, the seals and the latest entries of the log."""

from pathlib import Path

from nicegui import ui

from checkweigher_web.access.users import Role
from checkweigher_web.elements import Table, scrolled, show_told
from checkweigher_web.languages.language import Text
from checkweigher_web.work import actions
from checkweigher_web.work.audit_view import HEADS, AuditView
from checkweigher_web.work.dialogs import Desk, Dialog, field
from checkweigher_web.work.services import LaneServices, Outcome

_LEVELS = {True: 'level-OK', False: 'level-ERROR', None: 'about'}


async def audit_log(desk: Desk, services: LaneServices) -> None:
    """Open a dialog with the audit log of a lane.

    Raises `ActionRefusedError` if the lane has no audit log.
    """
    await AuditDialog(desk, await actions.audit_log(services)).update()


class AuditDialog(Dialog):
    """Dialog that shows an audit log and its seals."""

    def __init__(self, desk: Desk, log: Path) -> None:
        super().__init__(Text('Audit log'), desk.say, wide=True)
        self._desk = desk
        self._log = log
        self._reading = False
        with self.body:
            self._conclusion = ui.label('').classes('conclusion').props('role=status')
            self._seals = ui.label('').classes('seals')
            self._wanted = field(self.say('Filter: node, who, what, why'))
            self._wanted.props('debounce=300').on_value_change(self.update)
            self._count = ui.label('').classes('about count').props('role=status')
            with scrolled('audit', self.say('entries')):
                self._rows = Table(map(self.say, HEADS))
        self.button(Text('Read again'), self.update)

    async def update(self) -> None:
        """Read and show the log, and repeat this if the filter has changed meanwhile.

        Shows a refusal instead if the user is no longer an operator. Does nothing while an earlier
        call reads the log.
        """
        if self._reading:
            return
        if self._desk.role < Role.OPERATOR:
            self.tell(Outcome(False, Text('this needs a login as operator')))
            return
        self._reading, read = True, None
        self._count.set_text(self.say('reading {path} ...', path=self._log))
        try:
            while read != (wanted := str(self._wanted.value or '')):
                read = wanted
                view = await self._desk.auditor.read(self._log, wanted)
                if self._count.is_deleted:  # The user has closed the dialog.
                    return
                self._show(view)
        finally:
            self._reading = False

    def _show(self, view: AuditView) -> None:
        show_told(self._conclusion, view.conclusion, self.say)
        self._conclusion.set_text(f'{"✓" if view.whole else "✗"} {self._conclusion.text}')
        self._conclusion.classes(replace=f'conclusion {_LEVELS[view.whole]}')
        show_told(self._seals, view.seals, self.say)
        self._seals.classes(replace=f'seals {_LEVELS[view.seals_hold]}')
        self._count.set_text(f'{self._log}: {self.say(view.count)}' if view.count else '')
        self._rows.show(view.rows)
