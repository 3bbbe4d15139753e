# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the item list, in which a viewer chooses the item whose signal the page shows."""

from nicegui import json, ui

from checkweigher_web.drawing import row_key
from checkweigher_web.elements import ItemList
from checkweigher_web.lane import ShownItem
from checkweigher_web.languages.language import Language, Text
from checkweigher_web.languages.words import said
from checkweigher_web.views.view import FAST, Look, View

_SHOWN = 100  # maximum number of items in the list
_HEADS = (
    Text('item'),
    Text('time'),
    Text('gross, {unit}'),
    Text('± {unit}'),
    Text('reference {unit}'),
    Text('verdict'),
)


class ItemListView(View):
    """List of the latest items, or only of the faults."""

    title = Text('Items')
    columns = 1, 5
    period = FAST

    def _build(self) -> None:
        ui.checkbox(self.say('faults only')).bind_value_to(self.look, 'only_faults')
        with ui.element('div').classes('items'):
            heads = (self.say(head, unit=self.say.unit) for head in _HEADS)
            self._list = ItemList(heads, self.look.choose, self.say('show item'))

    def _show(self) -> None:
        self._list.show_text(rows_of(self.look))
        self._list.choose(self.look.chosen)


def rows_of(look: Look) -> str:
    """Return at most `_SHOWN` rows of the list as JSON.

    The rows contain the chosen item if it is one of the selected items, otherwise the latest items.
    """
    drawing, items = look.drawing, look.items()
    keys = [row_key(item) for item in items] if look.chosen else []
    place = keys.index(look.chosen) if look.chosen in keys else 0
    begin = 0 if place < _SHOWN else place - _SHOWN // 2

    def draw() -> str:
        return json.dumps([_row(item, look.say) for item in items[begin : begin + _SHOWN]])

    if begin or look.span is not None:
        return draw()
    return drawing.once(('rows', look.only_faults, look.say), drawing.lane.version, draw)


def _row(item: ShownItem, say: Language) -> list[str]:
    verdict = item.verdict
    key, decision = row_key(item), verdict.decision.name
    masses = (say.amount(mass) for mass in (verdict.mass, verdict.std_dev, item.reference))
    time = say.clock(verdict.time)
    return [key, str(verdict.item_id), decision, time, *masses, said(verdict, say)]
