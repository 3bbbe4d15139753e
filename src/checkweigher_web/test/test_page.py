# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Page of a running line in a real browser."""

from collections.abc import Iterator
from pathlib import Path
import re

from browsers import (
    WIDTHS,
    check_all_widths,
    errors_of,
    needs_browser,
    rows_of,
    shortcomings,
    text_of,
    until,
)
from node_process import spinning
from persons import Line, Person, add_users
import pytest
from rclpy.node import Node
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from served_page import line_of, served

from checkweigher_core.records import GRAMS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_recording.bags.reading import read_bag
from checkweigher_validation.accuracy.results import weigh

pytestmark = needs_browser
LINE = {
    'driver': {'source': 'simulator', 'simulator': {'count': 0, 'seed': 3}},
    'reject': {'lower_limit': 0.1, 'upper_limit': 0.2},
}


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('line')
    (folder / 'kept').mkdir()
    add_users(folder / 'users')
    return folder


@pytest.fixture(scope='module')
def port(folder: Path) -> Iterator[int]:
    options = '--users', str(folder / 'users'), '--keep', str(folder / 'kept')
    with line_of(folder / 'line.yaml', LINE), served(*options) as (_, found):
        yield found


def test_an_item_is_shown_with_mass_verdict_and_signal(browser: Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: len(rows_of(browser)) >= 6)
    # On a busy machine, the mass of an item may come too late.
    weighed = [row for row in rows_of(browser) if 'FAULT' not in row[-1]]
    number, _, mass, _, reference, verdict = weighed[0]
    assert int(number) > 0
    assert abs(float(mass) - float(reference)) < 1
    lower = {'OVER': 0.2e3, 'ACCEPT': 0.1e3}.get(verdict.split()[1], 0)
    assert float(mass) > lower
    until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
    assert text_of(browser, '.decision') in ('ACCEPT', 'UNDER', 'OVER', 'FAULT')
    assert {'lower 100', 'upper 200'} <= set(text_of(browser, '.scale').split('\n'))
    drawn = 'return [...document.querySelectorAll(".chart")].map(e => !!e.querySelector("canvas"))'
    until(browser, lambda: all(browser.execute_script(drawn)))
    assert errors_of(browser) == []


def test_an_item_can_be_chosen_with_the_keyboard_alone(browser: Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: len(rows_of(browser)) >= 3)
    button = browser.find_elements(By.CSS_SELECTOR, '.items tbody button')[2]
    name = str(button.get_attribute('aria-label'))
    button.send_keys(Keys.ENTER)
    chosen = 'tr.chosen button'
    until(browser, lambda: browser.find_elements(By.CSS_SELECTOR, chosen))
    label = 'return document.querySelector(arguments[0])?.ariaLabel'
    assert browser.execute_script(label, chosen) == name


@pytest.mark.parametrize('theme', ['light', 'dark'])
def test_everything_can_be_seen_and_has_a_name_at_any_width(browser: Chrome, port: int, theme: str):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: len(rows_of(browser)) >= 1)
    if theme not in browser.execute_script('return document.body.className'):
        for name in ('Menu', 'Dark or light'):
            path = f'//*[self::button or @role="menuitem"][normalize-space()="{name}"]'
            until(browser, lambda path=path: browser.find_elements(By.XPATH, path))
            browser.find_element(By.XPATH, path).click()
    until(browser, lambda: theme in browser.execute_script('return document.body.className'))
    check_all_widths(browser)
    right = 'return document.querySelector(arguments[0]).getBoundingClientRect().right'
    for width in WIDTHS:
        browser.set_window_size(width, 900)
        mass, panel = (browser.execute_script(right, each) for each in ('.mass', '.panel'))
        assert mass <= panel


def test_a_full_screen_shows_what_is_read_from_a_distance(browser: Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/?kiosk')
    until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
    panels = browser.find_elements(By.CSS_SELECTOR, '.board > .panel')
    seen = [str(each.get_attribute('aria-label')) for each in panels if each.is_displayed()]
    assert seen == ['Item', 'Over time']


def test_a_clock_that_differs_from_that_of_the_line_is_told(browser: Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: re.match(r'\d\d:\d\d:\d\d \w+', text_of(browser, '.clock')))
    assert text_of(browser, '.apart') == ''
    browser.execute_script('const now = Date.now; Date.now = () => now() + 60000')
    until(browser, lambda: 's ahead of that of the line' in text_of(browser, '.apart'))
    assert shortcomings(browser) == []


def test_a_reading_is_grey_when_no_item_follows_it(browser: Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
    # Items come each second, which is more than a minute for the clock of this browser.
    browser.execute_script(
        'const now = performance.now.bind(performance); performance.now = () => 100 * now()'
    )
    until(browser, lambda: browser.find_elements(By.CSS_SELECTOR, '.reading.OLD'))
    until(browser, lambda: re.fullmatch(r'\d+ (s|min) ago', text_of(browser, '.ago')))


def test_signals_are_taken_only_while_somebody_looks(browser: Chrome, port: int):
    with spinning():
        nodes = Node('watcher').get_node_names
        browser.get('about:blank')  # close the page of an earlier test
        until(browser, lambda: 'page_results' in nodes())
        until(browser, lambda: 'page_signals' not in nodes())
        browser.get(f'http://127.0.0.1:{port}/')
        until(browser, lambda: 'page_signals' in nodes())
        browser.get('about:blank')
        until(browser, lambda: 'page_signals' not in nodes())


@pytest.fixture
def anna(browser: Chrome, port: int, folder: Path) -> Person:
    person = Person(browser, Line(port, folder))
    person.log_in('anna')
    return person


def test_an_item_of_a_line_that_stands_is_no_news(browser: Chrome, anna: Person):
    def shade() -> str:
        return str(browser.execute_script('return document.querySelector(".reading").className'))

    until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
    until(browser, lambda: shade().split()[-1] in ('ACCEPT', 'UNDER', 'OVER', 'FAULT'))
    anna.does('Stop', '✓')
    until(browser, lambda: shade() == 'reading NONE')
    number, when = rows_of(browser)[0][:2]
    said = 'weighing is stopped, last item at '
    until(browser, lambda: text_of(browser, '.item').split('\n')[1] == said + when)
    assert f'item {number}' in text_of(browser, '.item')
    assert shortcomings(browser) == []
    anna.does('Start', '✓')
    until(browser, lambda: shade() != 'reading NONE')
    assert 'stopped' not in text_of(browser, '.item')


def test_an_item_of_the_running_line_is_kept(
    browser: Chrome, port: int, folder: Path, anna: Person
):
    anna.log_out()
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: rows_of(browser))
    assert 'keep this item' not in text_of(browser, 'main')
    anna.log_in('anna')

    said: list[str] = []

    def kept() -> bool:
        """Keep the latest item, and return whether the page held its samples."""
        anna.press('keep this item', '.signal')
        anna.press('Keep')
        anna.until(lambda: anna.text('.dialog .result'))
        said.append(anna.text('.dialog .result'))
        anna.close()
        return said[-1].startswith('✓')

    until(browser, kept)
    (bag,) = (folder / 'kept').iterdir()
    number = bag.name.partition('_')[0].removeprefix('item')
    until(browser, lambda: number in [each[0] for each in rows_of(browser)])
    (row,) = [each for each in rows_of(browser) if each[0] == number]
    found = re.search(r'item (\d+) of this bag, ([\d.]+) g, (\w+)', said[-1])
    assert found, said
    assert found[3] == row[5].split()[1]
    assert float(found[2]) == pytest.approx(float(row[2]), abs=0.1 * float(row[3]) + 0.001)
    results = weigh(read_bag(bag), LineParameters.from_file(folder / 'line.yaml'))
    verdict = results[int(found[1]) - 1].verdict
    assert (f'{GRAMS * verdict.mass:.3f}', verdict.decision.name) == (found[2], found[3])
