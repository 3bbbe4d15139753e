# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The list of items, in which a viewer chooses the item whose signal is shown."""

from nicegui import json, ui

from checkweigher_web.drawing import Drawing, row_key
from checkweigher_web.elements import ItemList
from checkweigher_web.lane import ShownItem
from checkweigher_web.views.view import FAST, View
from checkweigher_web.words import grams, said, when

_SHOWN = 100  # items
_HEADS = 'item', 'time', 'gross, g', '± g', 'reference g', 'verdict'


class ItemListView(View):
    """The latest items, or the faults among them."""

    title = 'Items'
    columns = 1, 5
    period = FAST
    style = """
@media (min-width: 50rem) and (max-width: 79.99rem) { .list { grid-row: span 2; } }
.items { height: 26rem; overflow: auto; width: 100%; }
.items thead th { position: sticky; top: 0; background: var(--card); }
.items :is(th, td):is(:nth-child(3), :nth-child(4), :nth-child(5)) { text-align: right; }
.items td:last-child { font-weight: 600; }
.items .ACCEPT td:last-child { color: var(--green); }
.items :is(.UNDER, .OVER) td:last-child { color: var(--amber); }
.items .FAULT td:last-child { color: var(--red); }
.items button { font: inherit; color: var(--blue); background: none; border: 0; cursor: pointer;
  padding: 0.1rem 0.4rem; margin: -0.1rem -0.4rem; text-decoration: underline; }
.items tr.chosen { outline: 2px solid var(--blue); outline-offset: -2px; }
@container (max-width: 32rem) {
  .items table.plain :is(th, td) { padding: 0.25rem; }
  .items td:last-child { overflow-wrap: anywhere; }
  .items :is(th, td):is(:nth-child(4), :nth-child(5)) { display: none; }
}
"""

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
