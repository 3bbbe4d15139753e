# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The elements of the page: panels, figures, tables."""

from collections.abc import Callable, Iterable, Sequence
import json
from pathlib import Path

from nicegui import ui
from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement

from checkweigher_core.health.findings import Level
from checkweigher_web.charts import nothing

STYLE = Path(__file__).with_name('page.css')  # of all pages; views have their own as well


def panel(title: str, name: str = '') -> Element:
    """Return a part of the page with a heading; `name` is its class in CSS."""
    panel = ui.element('section').classes(f'panel {name}').props(f'aria-label="{title}"')
    with panel:
        ui.html(f'<h2>{title}</h2>', sanitize=False)
    return panel


def show_lines(parent: Element, lines: Iterable[str]) -> None:
    """Show lines of text as the items of a list, in place of those before."""
    parent.clear()
    for line in lines:
        with parent, ui.element('li'):
            ui.label(line)


class _FromText(ui.element):
    """An element that shows one text of JSON, by its property `_of`."""

    _of = ''

    def show(self, text: str) -> None:
        """Show a text; the present one is not sent again."""
        if self.props.get(self._of) != text:
            self.props[self._of] = text


class Figure(_FromText, ui.echart, component='figure.js'):  # that brings ECharts
    """A figure of ECharts, from its options as JSON.

    NiceGUI handles one text cheaply. Of options it would inspect each point for each viewer.
    """

    _of = 'text'

    def __init__(self, label: str) -> None:
        super().__init__({})
        for name in ('options', 'enable-3d', 'renderer', 'theme'):
            self.props.pop(name)
        self._update_method = None
        self.classes('chart').props(f'role=img aria-label="{label}"')
        self.show(json.dumps(nothing('waiting for items')))


class Rows(_FromText, component='rows.js'):
    """A table of many rows, which as one text of JSON cost NiceGUI nothing for each cell."""

    _of = 'rows'

    def __init__(self, heads: Iterable[str]) -> None:
        super().__init__()
        self.props['heads'] = list(heads)
        self.show('[]')


class ItemList(Rows, component='items.js'):
    """The list of items; `choose` is called with the key of a row."""

    def __init__(self, heads: Iterable[str], choose: Callable[[str], None]) -> None:
        super().__init__(heads)
        self.on('choose', lambda event: choose(str(event.args)))

    def choose(self, key: str) -> None:
        """Mark a row; '' for none."""
        if self.props.get('chosen', '') != key:
            self.props['chosen'] = key


class Table:
    """A table whose texts change in place, because most stay and elements are expensive.

    A table without rows is not shown. The texts of the column `linked` are links. Each cell has its
    head as an attribute, which a narrow page shows beside it.
    """

    def __init__(self, heads: tuple[str, ...], linked: int | None = None) -> None:
        self._heads = heads
        self._linked = linked
        self._rows: list[tuple[Element, list[TextElement]]] = []
        with ui.element('table').classes('plain') as self._table:
            with ui.element('thead'), ui.element('tr'):
                for head in heads:
                    with ui.element('th').props('scope=col'):
                        ui.label(head)
            self._body = ui.element('tbody')

    def show(self, rows: Iterable[tuple[str, ...]], targets: Sequence[str] = ()) -> None:
        """Show rows, each with a text for each column; `targets` are the targets of the links."""
        given = list(rows)
        self._table.set_visibility(bool(given))
        while len(self._rows) > len(given):
            self._rows.pop()[0].delete()
        while len(self._rows) < len(given):
            with self._body, ui.element('tr') as row:
                self._rows.append((row, [self._cell(place) for place in range(len(self._heads))]))
        for (_, cells), texts in zip(self._rows, given, strict=True):
            for cell, text in zip(cells, texts, strict=True):
                cell.set_text(text)
            first = texts[0]
            cells[0].classes(replace=f'level-{first}' if first in Level.__members__ else '')
        if self._linked is not None:
            for (_, cells), target in zip(self._rows, targets, strict=True):
                link = cells[self._linked]
                if link.props.get('href') != target:
                    link.props['href'] = target

    def _cell(self, place: int) -> TextElement:
        with ui.element('td').props(f'data-head="{self._heads[place]}"'):
            return ui.link('', '') if place == self._linked else ui.label('')
