# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pages in each language in a real browser: nothing is wider than its place."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
import re

from browsers import errors_of, needs_browser, open_browser
from persons import Technician, new_line
import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from checkweigher_web.commissioning.registry import STEPS
from checkweigher_web.languages.language import NAMES, language

WIDTHS = 390, 1000, 1600  # px
# Visible labels and buttons whose text is wider than their box, and the document if it is.
_TOO_WIDE = """
const root = document.documentElement;
const found = root.scrollWidth > window.innerWidth ? [`document: ${root.scrollWidth} px`] : [];
const names = '.q-btn, .q-btn__content, .q-item, .fact, .clock, .title, .tab .name, h1, h2, '
  + '.login label, .login button, .said, .mass, .panel, .dialog, .foot, .buttons';
for (const e of document.querySelectorAll(names)) {
  if (e.checkVisibility() && e.clientWidth && e.scrollWidth > e.clientWidth + 1) {
    found.push(`${e.className || e.tagName}: ${e.innerText.slice(0, 40)}`);
  }
}
return found;
"""
# Wait for the fonts, because an icon is shown as a long word until its font is loaded.
_FONTS_ARE_LOADED = 'const [done] = arguments; document.fonts.ready.then(() => done(true))'


class Reader(Technician):
    """Technician who reads the page in a language."""

    name = NAMES[0]

    def choose_german(self) -> None:
        """Choose German in the menu of the English page."""
        self.menu('Language and unit')
        self.until(lambda: self.clicked('.dialog .q-select'))
        self.until(lambda: self.clicked('.q-menu .q-item', 'Deutsch'))
        self.until(lambda: self.language() == 'de')
        self.name = 'de'
        self.until(lambda: self.text('.mass'))

    def prefer(self, **values: str) -> None:
        """Set the cookies of a language and a unit, and load the page of the line."""
        for name, value in values.items():
            self.browser.add_cookie({'name': f'checkweigher-{name}', 'value': value})
        self.browser.get(f'http://127.0.0.1:{self.line.port}/')
        self.until(lambda: self.text('.mass'))
        self.name = values['language']

    def language(self) -> str:
        return str(self.browser.execute_script('return document.documentElement.lang'))

    def menu(self, entry: str) -> None:
        self.choose_in_menu(entry, language(self.name)('Menu'))

    def sees_german_date(self) -> bool:
        """Move the pointer over the last hour, and return whether its time is as in German."""
        figure = self.browser.find_element(By.CSS_SELECTOR, '.hour .chart')
        mouse = ActionChains(self.browser).scroll_to_element(figure).move_to_element(figure)
        mouse.move_by_offset(1, 0).perform()
        return bool(re.search(r'\d\d\.\d\d\.\d{4}, \d\d:\d\d:\d\d', figure.text))

    def places(self) -> Iterator[Callable[[], object]]:
        """Open the parts of the page one by one, and yield for each a function that closes it."""
        say = language(self.name)

        def close() -> None:
            asks = say('Cancel') in self.buttons('.dialog')
            self.press(say('Cancel') if asks else say('Close'))
            self.until(lambda: not self.text('.dialog'))

        yield lambda: None
        self.press(say('Menu'), '.head')
        self.until(lambda: self.text('.q-menu'))
        yield lambda: self.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
        for opened in (say('Acknowledge alarms'), say('Recipes')):
            self.until(lambda: not self.text('.q-menu'))
            self.menu(opened)
            self.until(lambda opened=opened: self.text('.dialog h2') == opened)
            yield close
        self.menu(say('Commissioning'))
        for number, step in enumerate(STEPS, 1):
            title = f'{number} {say(step.title)}'
            self.until(lambda title=title: self.clicked('.stages .name', title))
            self.until(lambda step=step: self.text('.stage:not(.hidden) h2') == say(step.title))
            yield lambda: None
        self.press(say('Log out'), '.head')
        self.until(lambda: self.text('.login button') == say('Log in'))
        assert self.language() == say.tag
        yield lambda: None


@needs_browser
@pytest.mark.parametrize(
    ('names', 'widths'), [(['de'], WIDTHS[:1]), pytest.param(NAMES, WIDTHS, marks=pytest.mark.soak)]
)
def test_each_page_fits_in_each_language(
    tmp_path: Path, names: Sequence[str], widths: Sequence[int]
):
    too_wide: list[str] = []
    with new_line(tmp_path, {}) as line, open_browser(tmp_path / 'browser') as browser:
        ben = Reader(browser, line)
        for name in names:
            ben.log_in('ben')
            ben.until(lambda: ben.text('.mass'))
            if name == 'de':
                ben.choose_german()
            else:
                ben.prefer(language=name)
            for place, close in enumerate(ben.places()):
                for width in widths:
                    browser.set_window_size(width, 900)
                    ben.until(lambda w=width: browser.execute_script('return innerWidth') == w)
                    browser.execute_async_script(_FONTS_ARE_LOADED)
                    found = browser.execute_script(_TOO_WIDE)
                    too_wide += [f'{name} {place} {width} px: {each}' for each in found]
                close()
        ben.prefer(language='de', unit='kg')
        ben.until(lambda: 'brutto, kg' in ben.text('.items thead'))
        ben.until(ben.sees_german_date)
        assert errors_of(browser) == []
    assert too_wide == []
