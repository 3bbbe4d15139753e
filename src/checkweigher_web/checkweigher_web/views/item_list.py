# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the list of items, in which a viewer chooses the item whose signal is shown."""

from nicegui import json, ui

from checkweigher_web.drawing import Drawing, row_key
from checkweigher_web.elements import ItemList
from checkweigher_web.lane import ShownItem
from checkweigher_web.views.view import FAST, View
from checkweigher_web.words import grams, said, when

_SHOWN = 100  # maximum number of items in the list
_HEADS = 'item', 'time', 'gross, g', '± g', 'reference g', 'verdict'


class ItemListView(View):
    """The latest items, or only the faults."""

    title = 'Items'
    columns = 1, 5
    period = FAST

    def _build(self) -> None:
        ui.checkbox('faults only').bind_value_to(self.look, 'only_faults')
        with ui.element('div').classes('items').props('tabindex=0 aria-label="list of items"'):
            self._list = ItemList(_HEADS, self.look.choose)

    def _show(self) -> None:
        self._list.show_text(rows_of(self.drawing, only_faults=self.look.only_faults))
        self._list.choose(self.look.chosen)


def rows_of(drawing: Drawing, *, only_faults: bool = False) -> str:
    """Return the rows of the list as JSON."""
    items = drawing.items(only_faults=only_faults)[:_SHOWN]
    return drawing.once(
        ('rows', only_faults), drawing.lane.version, lambda: json.dumps([_row(i) for i in items])
    )


def _row(item: ShownItem) -> list[str]:
    verdict = item.verdict
    key, decision = row_key(item.key), verdict.decision.name
    masses = (grams(mass) for mass in (verdict.mass, verdict.std_dev, item.reference))
    return [key, str(verdict.item_id), decision, when(verdict), *masses, said(verdict)]
