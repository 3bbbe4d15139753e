# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A line on a simulated scale with its page, and a person at the browser who works on it."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from browsers import is_at_rest, text_of, until
from selenium.common.exceptions import WebDriverException
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from served_page import line_of, served
import yaml

from checkweigher_production.audit_log import read_log
from checkweigher_web.access.users import Role, User, hash_password, write_users

PASSWORD = 'correct horse'
SCRIPT = '<img src=x onerror=alert(1)>'
_BESIDE_MENU = 'Start', 'Stop', 'Product', 'New batch', 'Zero'  # the menu has all other actions
_WATCH_CLICK = (
    'window.missed = true;'
    'arguments[0].addEventListener("click", () => { window.missed = false }, {once: true});'
)
# Of each unit behind a field: whether all of it is beside the text, within the frame.
_UNITS = (
    'return [...document.querySelectorAll(".dialog .q-field__suffix")].map(unit => {'
    '  const field = unit.closest(".q-field__control"), place = unit.getBoundingClientRect();'
    '  const frame = field.getBoundingClientRect();'
    '  const text = field.querySelector("input").getBoundingClientRect();'
    '  return frame.left <= text.left && text.right <= place.left && place.right <= frame.right'
    '    && frame.top <= place.top && place.bottom <= frame.bottom && place.width > 0;'
    '});'
)
# Of what is in the body of the dialog: whether it ends before the padding of the dialog.
_WITHIN = (
    'const dialog = document.querySelector(".dialog");'
    'const edge = dialog.getBoundingClientRect().right'
    '  - parseFloat(getComputedStyle(dialog).paddingRight);'
    'return [...dialog.querySelectorAll(".fields > *")].filter(each => each.checkVisibility())'
    '  .map(each => each.getBoundingClientRect().right <= edge + 0.5);'
)


@dataclass
class Line:
    """A line on a simulated scale, with its page."""

    port: int
    folder: Path
    scheme: str = 'http'

    def noted(self, name: str) -> list[str]:
        """Return what the audit log has of a person."""
        entries = read_log(self.folder / 'audit.log').entries
        return [str(each.new) for each in entries if (each.kind, each.subject) == ('person', name)]


def add_users(path: Path) -> None:
    """Write a file of users: an operator, a technician and a viewer."""
    known = hash_password('x', PASSWORD)
    roles = {'anna': Role.OPERATOR, 'ben': Role.TECHNICIAN, 'vera': Role.VIEWER}
    write_users(path, {name: User(name, role, known) for name, role in roles.items()})


@contextmanager
def new_line(
    folder: Path,
    values: Mapping[str, Mapping[str, object]],
    *options: str,
    products: Mapping[str, object] | None = None,
) -> Iterator[Line]:
    """Run a simulated line of a new machine as a user would, with its page.

    `values` are parameters by node, `options` those of the page, `products` are the recipes.
    """
    users, machine = folder / 'users', folder / 'machine'
    add_users(users)
    machine.mkdir()
    if products is not None:
        (machine / 'recipes.yaml').write_text(yaml.safe_dump({'products': products}))
    page = '--users', str(users), '--keep', str(folder), *options
    with (
        line_of(folder / 'params.yaml', values, '--folder', str(machine)),
        served(*page) as (_, port),
    ):
        yield Line(port, machine)


class Person:
    """Somebody at the browser."""

    def __init__(self, browser: Chrome, line: Line) -> None:
        self.browser, self.line = browser, line

    def until(self, condition: Callable[[], object]) -> object:
        return until(self.browser, condition)

    def log_in(self, name: str) -> None:
        self.browser.set_window_size(800, 900)
        self.browser.get(f'{self.line.scheme}://127.0.0.1:{self.line.port}/login')
        self.browser.find_element(By.NAME, 'name').send_keys(name)
        self.browser.find_element(By.NAME, 'password').send_keys(PASSWORD + Keys.ENTER)
        self.until(lambda: name in self.text('.head'))

    def text(self, selector: str) -> str:
        return text_of(self.browser, selector)

    def buttons(self, where: str) -> dict[str, object]:
        found = self.browser.find_elements(By.CSS_SELECTOR, f'{where} button')
        return {each.text.strip(): each for each in found}

    def press(self, name: str, where: str = '.dialog') -> None:
        inside = where if where.endswith('.q-item') else f'{where} button'
        self.until(lambda: self.clicked(inside, name))

    def open_menu(self) -> None:
        self.until(self._has_opened_menu)

    def choose_in_menu(self, name: str, menu: str = 'Menu') -> None:
        """Open the menu and choose an entry. While it loads, the page may close the menu again."""
        entry = '.q-menu .q-item'
        self.until(lambda: self._has_opened_menu(menu) and self.clicked(entry, name))

    def _has_opened_menu(self, name: str = 'Menu') -> bool:
        if self.text('.q-menu'):
            return True
        self.clicked('.head button', name)
        return False

    def entries(self) -> list[str]:
        """Return the entries of the menu."""
        self.open_menu()
        found = self.text('.q-menu').split('\n')
        self.browser.switch_to.active_element.send_keys(Keys.ESCAPE)
        self.until(lambda: not self.text('.q-menu'))
        return found

    def open(self, name: str) -> None:
        if name in _BESIDE_MENU:
            self.press(name, '.work')
        else:
            self.choose_in_menu(name)
        self.until(lambda: self.text('.dialog h2') == name)

    def fill(self, label: str, text: str) -> None:
        path = f':is(.dialog, .path) input[aria-label^="{label}"]'

        def shown() -> list[WebElement]:
            found = self.browser.find_elements(By.CSS_SELECTOR, path)
            return [each for each in found if each.is_displayed()]

        self.until(shown)
        field = shown()[-1]
        field.send_keys(Keys.CONTROL, 'a')
        field.send_keys(text or Keys.BACKSPACE)

    def choose(self, name: str) -> None:
        self.until(lambda: self.clicked('.dialog .q-select'))
        self.until(lambda: self.clicked('.q-menu .q-item', name))

    def clicked(self, selector: str, text: str = '') -> bool:
        # While a dialog before it fades out, it is in the way.
        found = self.browser.find_elements(By.CSS_SELECTOR, selector)
        for each in found:
            if text in ('', each.text.strip()):
                with suppress(WebDriverException):
                    return self._has_clicked(each)
        return False

    def _has_clicked(self, element: WebElement) -> bool:
        # A dialog that is just opening or growing has to come to rest. What moves later than that
        # is watched for.
        if not is_at_rest(self.browser, element):
            return False
        self.browser.execute_script(_WATCH_CLICK, element)
        element.click()
        return bool(self.browser.execute_script('return window.missed !== true'))

    def attribute(self, selector: str, name: str) -> str:
        script = 'return document.querySelector(arguments[0])?.getAttribute(arguments[1]) ?? ""'
        return str(self.browser.execute_script(script, selector, name))

    def units(self) -> list[bool]:
        """Tell of the unit behind each field of the dialog whether it can be seen beside it."""
        return list(self.browser.execute_script(_UNITS))

    def fits(self, width: int) -> bool:
        """Tell whether what is in the dialog stays within it in a window of a width, px."""
        size = self.browser.get_window_size()
        self.browser.set_window_size(width, size['height'])
        self.until(lambda: self.browser.execute_script('return window.innerWidth') == width)
        within = self.browser.execute_script(_WITHIN)
        self.browser.set_window_size(size['width'], size['height'])
        return len(within) > 0 and all(within)

    def result(self, sign: str) -> str:
        self.until(lambda: self.text('.dialog .result').startswith(sign))
        return self.text('.dialog .result')

    def does(self, name: str, sign: str, verb: str = '', choice: str = '', **fields: str) -> str:
        """Open a dialog, choose and fill in what it asks for, act, and return the result.

        A field is named by the first word of its label.
        """
        self.open(name)
        if choice:
            self.choose(choice)
        for label, text in fields.items():
            self.fill(label, text)
        self.press(verb or name)
        result = self.result(sign)
        self.close()
        return result

    def close(self) -> None:
        self.press('Close')
        self.until(lambda: not self.text('.dialog'))

    def log_out(self) -> None:
        self.press('Log out', '.head')
        self.until(lambda: self.browser.current_url.endswith('/login'))


class Technician(Person):
    """Person who commissions a machine."""

    def commission(self, step: str) -> None:
        """Open a step of the commissioning page."""
        if not self.text('.path'):
            self.choose_in_menu('Commissioning')
        self.until(lambda: any(self.clicked('.stages .name', f'{step}{end}') for end in ('', ' ✓')))
        self.until(lambda: self.text(f'.stage.{step.split()[1].lower()}'))

    def standing(self, step: str) -> str:
        """Return the text of a step in the list of steps."""
        tabs = self.browser.find_elements(By.CSS_SELECTOR, '.stages .tab')
        return next(each.text for each in tabs if each.text.startswith(step))

    def make(self, button: str) -> None:
        """Press a button at the foot of the page as soon as it is enabled."""
        self.until(lambda: self.clicked('.foot button:not(.disabled)', button))

    def said(self, *words: str) -> str:
        """Wait until the outcome contains some words, and return it."""
        self.until(lambda: all(word in self.text('.foot .result') for word in words))
        return self.text('.foot .result')
