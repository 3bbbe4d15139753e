# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the diagnostics of the nodes of a lane."""

from collections import Counter

from nicegui import ui

from checkweigher_core.health.findings import Level
from checkweigher_web.elements import Table, level_cell, told
from checkweigher_web.languages.language import Text
from checkweigher_web.languages.wording import from_node
from checkweigher_web.views.view import View


class DiagnosticsView(View):
    """Diagnostics with a level other than OK, each with a hint, the worst level first."""

    title = Text('Diagnostics')
    columns = 1, 5
    recorded = False

    def _build(self) -> None:
        self._headline = ui.label('').classes('about')
        self._rows = Table(
            (self.say('level'), self.say('node'), self.say('what is, and what to check'))
        )

    def _state(self) -> object:
        return self.look.nodes()

    def _show(self) -> None:
        rows = self.look.nodes()
        counts = Counter(row.level for row in rows)
        self._headline.set_text(
            self.say(
                '{silent} silent, {errors} with an error, {warnings} with a warning, {well} well',
                silent=counts[Level.STALE],
                errors=counts[Level.ERROR],
                warnings=counts[Level.WARN],
                well=counts[Level.OK],
            )
        )
        self._rows.show(
            (
                level_cell(row.level, self.say),
                f'{row.node} {row.aspect}',
                told(from_node(row.message), self.say),
            )
            for row in rows
            if row.level != Level.OK
        )
