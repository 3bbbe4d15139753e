# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Elements of the page: panels, figures and tables."""

from collections.abc import Callable, Iterable, Sequence
import json
from pathlib import Path
import time
from typing import NamedTuple, TypeVar

from nicegui import ui
from nicegui.element import Element

from checkweigher_core.health.findings import Level
from checkweigher_core.records import NANOSECONDS
from checkweigher_web.charts import nothing
from checkweigher_web.languages.language import Language

STYLE = Path(__file__).with_name('page.css')  # style sheet of all pages
E = TypeVar('E', bound=Element)
Link = tuple[str, str]  # text and address of a link


class Told(NamedTuple):
    """Text of a table cell.

    `level` is the name of the diagnostic level that colours the text, or ''. `lang` is the language
    of a text that is not translated, or ''.
    """

    text: str
    level: str = ''
    lang: str = ''


Cell = str | Link | Told


def panel(title: str, name: str = '') -> Element:
    """Add a panel with a heading and the CSS class `name` to the page, and return it."""
    panel = named(ui.element('section').classes(f'panel {name}'), title)
    with panel:
        ui.html(f'<h2>{title}</h2>', sanitize=False)
    return panel


def scrolled(name: str, label: str) -> Element:
    """Add a container of CSS class `name` that the keyboard can scroll, and return it.

    Screen readers read `label` as the name of the container.
    """
    return named(ui.element('div').classes(name).props('role=group tabindex=0'), label)


def heading(text: str) -> Element:
    """Add the main heading of a page, and return it."""
    label = ui.label(text).classes('title')
    label.tag = 'h1'
    return label


def text_file_input(label: str, longest: int, take: Callable[[str], object]) -> Element:
    """Add an input for a text file, and return it.

    When the user chooses a file, the input calls `take` with the text in the first `longest` bytes
    of the file. The browser does not read the rest of a longer file.
    """
    read = f'(event) => event.target.files[0]?.slice(0, {longest}).text().then(t => emit(t))'
    found = named(ui.element('input').props('type=file'), label)
    return found.on('change', lambda event: take(str(event.args)), js_handler=read)


def told(text: str, say: Language) -> Told:
    """Return a cell with the translation of a text. An untranslated text is marked as English."""
    return Told(say(text), lang='' if say.knows(text) else 'en')


def level_cell(level: Level, say: Language) -> Told:
    """Return the name of a level as a cell in the colour of the level."""
    return Told(say(level.name), level.name)


def show_told(label: ui.label, text: str, say: Language) -> None:
    """Show the translation of a text in a label. An untranslated text is marked as English."""
    label.set_text(say(text))
    label.props(f'lang={say.tag if say.knows(text) else "en"}')


def named(element: E, label: str) -> E:
    """Set the accessible name of an element, for screen readers, and return the element."""
    element.props['aria-label'] = label
    return element


def menu_entry(text: str, click: Callable[[], object]) -> Element:
    """Add an entry to the enclosing menu, and return it. The entry calls `click` when selected."""
    return ui.menu_item(text, click).props('role=menuitem')


class _FromText(ui.element):
    """Element whose content is a JSON text in the property that `_of` names.

    The content is one text, because NiceGUI compares the properties of an element for each viewer,
    and one text is cheaper to compare than many cells or options.
    """

    _of = 'rows'

    def show_text(self, text: str) -> None:
        """Send a text to the browser, unless the browser already shows it."""
        if self.props.get(self._of) != text:
            self.props[self._of] = text


class Figure(_FromText, ui.echart, component='figure.js'):
    """Figure that ECharts draws from options in JSON. The base class `ui.echart` loads ECharts.

    A `linked` figure has a time axis, and emits two events. The event `span` contains both ends of
    the selected part of the axis, or null for the whole axis. The event `at` contains the position
    of a click on the axis. Positions are in ms of local time, as `charts.local_times` returns them.
    """

    _of = 'text'

    def __init__(self, label: str, say: Language, *, linked: bool = False) -> None:
        super().__init__({})
        for name in ('options', 'enable-3d', 'renderer', 'theme'):
            self.props.pop(name)
        self._update_method = None
        named(self.classes('chart').props('role=img'), label)
        self.props['linked'] = linked
        self.show_text(json.dumps(nothing(say('waiting for items'))))


class ItemList(_FromText, component='items.js'):
    """List of items, recipes or users, which calls `choose` with the key of a row that is clicked.

    Screen readers read `verb` before the first cell of a row.
    """

    def __init__(self, heads: Iterable[str], choose: Callable[[str], None], verb: str) -> None:
        super().__init__()
        self.props['heads'] = list(heads)
        self.props['verb'] = verb
        self.on('choose', lambda event: choose(str(event.args)))

    def choose(self, key: str) -> None:
        """Mark the row whose key is `key`, or no row if `key` is ''."""
        if self.props.get('chosen', '') != key:
            self.props['chosen'] = key


class Lines(_FromText, component='lines.js'):
    """List of lines of text."""

    _of = 'lines'

    def show(self, lines: Iterable[str]) -> None:
        """Replace the lines."""
        self.show_text(json.dumps(list(lines)))


class Pulse(ui.element, component='pulse.js'):
    """Element that warns if the page is out of date or the clocks differ, and sets the theme.

    The browser greys the page if the state that it shows is more than 3 s old, because the lane is
    silent or no heartbeat of the server arrives.
    """

    def __init__(self, say: Language) -> None:
        super().__init__()
        self._say = say
        self.props['texts'] = {
            'late': say('No news since {since}, for {ago} s: what is below is old'),
            'ahead': say(
                'The clock of this browser is {seconds} s ahead of that of the line; all times '
                'here are those of the line'
            ),
            'behind': say(
                'The clock of this browser is {seconds} s behind that of the line; all times here '
                'are those of the line'
            ),
        }

    def beat(self, age: float, wakes: str = '') -> None:
        """Send a heartbeat with the age in s of the state that the browser shows.

        A dimmed screen becomes bright again when `wakes` changes.
        """
        now = time.time()
        since = self._say.clock(round(NANOSECONDS * (now - age)))
        beat = self.props.get('beat', 0) + 1
        self.props.update(age=age, since=since, now=round(1000 * now), wakes=wakes, beat=beat)


class Reading(_FromText, component='reading.js'):
    """Large display of the mass and verdict of an item, with a scale that shows the limits."""

    _of = 'text'

    def __init__(self, say: Language) -> None:
        super().__init__()
        self.props['texts'] = {
            'none': say('no item yet'),
            'unknown': say('UNKNOWN'),
            'seconds': say('{count} s ago'),
            'minutes': say('{count} min ago'),
        }

    def show(self, text: str, age: float | None, *, still: bool) -> None:
        """Show the reading `text`, which is in JSON.

        `age` is the age of the reading in s, or None for a recorded item. `still` is true if the
        lane does not weigh. The reading is then grey.
        """
        if self.props.get('text') != text:
            self.props['age'] = -1 if age is None else round(age, 1)
        self.show_text(text)
        self.props['still'] = still


class Production(_FromText, component='production.js'):
    """Production figures, each with a small chart of its values over time, and a bar for each rule.

    The rules are the packers' rules of directive 76/211/EEC. A bar shows how much of the margin of
    its rule is used.
    """

    _of = 'text'


class Table(_FromText, component='rows.js'):
    """Table that is hidden while it has no rows."""

    def __init__(self, heads: Iterable[str]) -> None:
        super().__init__()
        self.props['heads'] = list(heads)
        self.show(())

    def show(self, rows: Iterable[Sequence[Cell]]) -> None:
        """Replace the rows. Each row has a cell for each column."""
        given = list(rows)
        self.set_visibility(bool(given))
        self.show_text(json.dumps(given))
