# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the fault reasons in a recorded shift."""

from collections import Counter

from nicegui import ui

from checkweigher_core.records.reasons import hint_of
from checkweigher_web.elements import Table
from checkweigher_web.languages.language import Text
from checkweigher_web.views.view import View


class FaultsView(View):
    """Fault reasons of the items that were weighed so far, the most frequent reason first."""

    title = Text('Faults')
    columns = 1, 7
    live = False

    def _build(self) -> None:
        self._headline = ui.label('').classes('about')
        self._reasons = Table((self.say('items'), self.say('reason'), self.say('what to check')))

    def _show(self) -> None:
        known = self.lane.statistics
        counts = zip(known.reasons, known.reason_counts, strict=True) if known else ()
        found = Counter(dict(counts)).most_common()
        self._headline.set_text('' if found else self.say('no fault until now'))
        self._reasons.show(
            (str(count), reason, self.say(hint_of(reason))) for reason, count in found
        )
