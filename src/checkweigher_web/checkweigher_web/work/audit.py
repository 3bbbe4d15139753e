# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The audit log of a lane: whether it is whole and sealed, and what was changed last."""

from pathlib import Path

from nicegui import ui

from checkweigher_production.audit_log import AuditError
from checkweigher_web.access.users import Role
from checkweigher_web.audit_view import HEADS, AuditView
from checkweigher_web.elements import Rows
from checkweigher_web.work import actions
from checkweigher_web.work.dialogs import Desk, Dialog, field
from checkweigher_web.work.services import LaneServices, Outcome

_ROLE = Role.OPERATOR
_LEVELS = {True: 'level-OK', False: 'level-ERROR'}


async def audit_log(desk: Desk, services: LaneServices) -> None:
    """Show the audit log of a lane."""
    await AuditDialog(desk, await actions.audit_log(services)).update()


class AuditDialog:
    """The dialog with an audit log, as it was when it was read last."""

    def __init__(self, desk: Desk, log: Path) -> None:
        self._desk = desk
        self._log = log
        self._reading = False
        self._dialog = Dialog('Audit log', wide=True)
        with self._dialog.body:
            self._conclusion = ui.label('').classes('conclusion').props('role=status')
            self._seals = ui.label('').classes('seals')
            self._wanted = field('Filter: node, who, what, why')
            self._wanted.props('debounce=300').on_value_change(self.update)
            self._count = ui.label('').classes('about count').props('role=status')
            with ui.element('div').classes('audit').props('tabindex=0 aria-label="entries"'):
                self._rows = Rows(HEADS)
        self._dialog.closing.set_text('Close')
        self._dialog.button('Read again', self.update)

    async def update(self) -> None:
        """Read the log; a text that is filled in meanwhile has it read again."""
        if self._reading:
            return
        if self._desk.role < _ROLE:
            self._dialog.tell(Outcome(False, f'this needs a login as {_ROLE.name.lower()}'))
            return
        self._reading, read = True, None
        self._count.set_text(f'reading {self._log} ...')
        try:
            while read != (wanted := str(self._wanted.value or '')):
                read = wanted
                view = await self._desk.auditor.read(self._log, wanted)
                if self._count.is_deleted:  # the dialog was closed meanwhile
                    return
                self._show(view)
        except AuditError as error:
            if not self._count.is_deleted:
                self._show_error(str(error))
        finally:
            self._reading = False

    def _show(self, view: AuditView) -> None:
        self._conclusion.set_text(f'{"✓" if view.whole else "✗"} {view.conclusion}')
        self._conclusion.classes(replace=f'conclusion {_LEVELS[view.whole]}')
        self._seals.set_text(view.seals)
        level = 'about' if view.seals_hold is None else _LEVELS[view.seals_hold]
        self._seals.classes(replace=f'seals {level}')
        self._count.set_text(f'{self._log}: {view.count}')
        self._rows.show_rows(view.rows)

    def _show_error(self, text: str) -> None:
        self._conclusion.set_text(f'✗ {text}')
        self._conclusion.classes(replace=f'conclusion {_LEVELS[False]}')
        for label in (self._seals, self._count):
            label.set_text('')
        self._rows.show_rows(())
