# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Elements of the page: panels, figures, tables."""

from collections.abc import Callable, Iterable, Sequence
import json
from pathlib import Path

from nicegui import ui
from nicegui.element import Element

from checkweigher_web.charts import nothing

STYLE = Path(__file__).with_name('page.css')  # style of all pages; views add their own
Cell = str | tuple[str, str]  # a text, or a text and the address that it links to


def panel(title: str, name: str = '') -> Element:
    """Return a part of the page with a heading; `name` is its CSS class."""
    panel = ui.element('section').classes(f'panel {name}').props(f'aria-label="{title}"')
    with panel:
        ui.html(f'<h2>{title}</h2>', sanitize=False)
    return panel


class _FromText(ui.element):
    """Element that shows one JSON text, its property named by `_of`.

    One text is cheap. NiceGUI would inspect each single option or cell for each viewer.
    """

    _of = 'rows'

    def show_text(self, text: str) -> None:
        """Show a text; it is not sent if it is shown already."""
        if self.props.get(self._of) != text:
            self.props[self._of] = text


class Figure(_FromText, ui.echart, component='figure.js'):  # echart loads ECharts
    """A figure of ECharts, from its options as JSON."""

    _of = 'text'

    def __init__(self, label: str) -> None:
        super().__init__({})
        for name in ('options', 'enable-3d', 'renderer', 'theme'):
            self.props.pop(name)
        self._update_method = None
        self.classes('chart').props(f'role=img aria-label="{label}"')
        self.show_text(json.dumps(nothing('waiting for items')))


class ItemList(_FromText, component='items.js'):
    """The list of items; `choose` is called with the key of a row."""

    def __init__(self, heads: Iterable[str], choose: Callable[[str], None]) -> None:
        super().__init__()
        self.props['heads'] = list(heads)
        self.on('choose', lambda event: choose(str(event.args)))

    def choose(self, key: str) -> None:
        """Mark a row; '' for none."""
        if self.props.get('chosen', '') != key:
            self.props['chosen'] = key


class Lines(_FromText, component='lines.js'):
    """A list of lines of text."""

    _of = 'lines'

    def show(self, lines: Iterable[str]) -> None:
        """Replace the lines."""
        self.show_text(json.dumps(list(lines)))


class Pulse(ui.element, component='pulse.js'):
    """Label with the age of the page. The browser greys the page while it receives no beat."""

    def beat(self, age: float) -> None:
        """Send the age of the state that the browser shows, in s."""
        self.props.update(age=age, beat=self.props.get('beat', 0) + 1)


class Table(_FromText, component='rows.js'):
    """Table, hidden while it has no rows.

    Each cell has the head of its column as an attribute, which a narrow page shows beside it.
    """

    def __init__(self, heads: Iterable[str]) -> None:
        super().__init__()
        self.props['heads'] = list(heads)
        self.show(())

    def show(self, rows: Iterable[Sequence[Cell]]) -> None:
        """Replace the rows, each with a cell for each column."""
        given = list(rows)
        self.set_visibility(bool(given))
        self.show_text(json.dumps(given))
