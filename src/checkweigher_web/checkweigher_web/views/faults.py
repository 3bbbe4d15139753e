# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reasons of the faults in a recorded shift."""

from nicegui import ui

from checkweigher_core.records.reasons import hint_of
from checkweigher_web.elements import Table
from checkweigher_web.views.view import View


class FaultsView(View):
    """Reasons of the faults so far, the most frequent first, each with what to check."""

    title = 'Faults'
    live = False

    def _build(self) -> None:
        self._headline = ui.label('').classes('about')
        self._reasons = Table(('items', 'reason', 'what to check'))

    def _show(self) -> None:
        known = self.lane.statistics
        found = list(zip(known.reason_counts, known.reasons, strict=True)) if known else []
        found.sort(key=lambda each: -each[0])
        self._headline.set_text('' if found else 'no fault until now')
        self._reasons.show((str(count), reason, hint_of(reason)) for count, reason in found)
