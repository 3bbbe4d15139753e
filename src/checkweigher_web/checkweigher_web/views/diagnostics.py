# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the diagnostics of the nodes of a lane."""

from nicegui import ui

from checkweigher_core.health.findings import Level
from checkweigher_core.ros.status_board import headline
from checkweigher_web.elements import Table
from checkweigher_web.views.view import View


class DiagnosticsView(View):
    """Diagnostics of a lane that are not OK, each with a hint, the worst first."""

    title = 'Diagnostics'
    columns = 1, 5
    recorded = False

    def _build(self) -> None:
        self._headline = ui.label('').classes('about')
        self._rows = Table(('level', 'node', 'what is, and what to check'))

    def _state(self) -> object:
        return self.look.nodes()

    def _show(self) -> None:
        rows = self.look.nodes()
        self._headline.set_text(headline(rows))
        self._rows.show(
            (row.level.name, f'{row.node} {row.aspect}', row.message)
            for row in rows
            if row.level != Level.OK
        )
