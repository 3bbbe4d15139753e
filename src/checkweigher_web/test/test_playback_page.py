# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a recorded shift in a real browser: slider, filter, faults, at any width, by keys."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from browsers import check_all_widths, errors_of, needs_browser, rows_of, text_of, until
from lines import edges_of, saturated_at, simulated, without_edges
import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from served_page import get, served

from checkweigher_core.records.reasons import Reason
from checkweigher_recording.bags.writing import write_bag

ITEMS, FAULTS = 12, {4: 'Saturation', 8: 'MissingEdge'}
pytestmark = needs_browser


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    sound = simulated(count=ITEMS, seed=6)
    broken = saturated_at(sound, edges_of(sound, 3)['t2'].stamp + 50_000_000)
    broken = without_edges(broken, edges_of(sound, 7)['t3'])
    path = tmp_path_factory.mktemp('bag') / 'shift'
    write_bag(path, broken.load_cell, broken)
    return path


@pytest.fixture(scope='module')
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('report') / 'report.html'
    path.write_text('<p>accuracy</p><script>document.title = "it ran"</script>')
    return path


@pytest.fixture(scope='module')
def port(bag: Path, report: Path) -> Iterator[int]:
    with served('--bag', str(bag), '--report', str(report)) as (_, found):
        yield found


@pytest.fixture(scope='module')
def opened(port: int, browser: Chrome) -> Chrome:
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: f'{ITEMS} items, {len(FAULTS)} faults' in text_of(browser, '.in-a-row'))
    return browser


@pytest.fixture
def page(opened: Chrome) -> Chrome:
    """Return the page at its first item, with all items listed."""
    opened.set_window_size(1600, 1000)
    opened.refresh()
    until(opened, lambda: text_of(opened, '.where').startswith(f'item 1 of {ITEMS}'))
    until(opened, lambda: len(rows_of(opened)) == 1)
    return opened


def press(page: Chrome, text: str) -> None:
    page.find_element(By.XPATH, f'//button[normalize-space()="{text}"]').send_keys(Keys.ENTER)


def test_the_slider_moves_through_the_items_by_the_keyboard(page: Chrome):
    slider = page.find_element(By.CSS_SELECTOR, '.slider')
    for _ in range(4):
        slider.send_keys(Keys.ARROW_RIGHT)
    until(page, lambda: text_of(page, '.where').startswith('item 5 of'))
    until(page, lambda: [int(row[0]) for row in rows_of(page)] == [5, 4, 3, 2, 1])
    slider.send_keys(Keys.ARROW_LEFT, Keys.ARROW_LEFT)
    until(page, lambda: [int(row[0]) for row in rows_of(page)] == [3, 2, 1])
    until(page, lambda: text_of(page, '.mass').endswith(' g'))


def test_a_fault_opens_its_signal_with_what_broke(page: Chrome):
    expected = {4: 'highest value of the converter', 8: 'outfeed eye: t3 is missing'}
    for number, text in expected.items():
        press(page, 'next fault')
        shown = partial(text_of, page, '.marks')
        until(page, lambda text=text, shown=shown: text in shown())
        assert text_of(page, '.where').startswith(f'item {number} of')
        assert text_of(page, '.decision') == '✗ FAULT'
    press(page, 'next fault')
    until(page, lambda: 'no fault after this item' in text_of(page, 'body'))


def test_the_filter_lists_the_faults_alone_and_a_choice_shows_its_signal(page: Chrome):
    press(page, 'next fault')
    press(page, 'next fault')
    page.find_element(By.CSS_SELECTOR, '[role=checkbox]').send_keys(Keys.SPACE)
    until(page, lambda: [int(row[0]) for row in rows_of(page)] == [8, 4])
    for row in rows_of(page):
        assert row[-1].split() == ['✗', 'FAULT', FAULTS[int(row[0])]]
    button = page.find_elements(By.CSS_SELECTOR, '.items tbody button')[1]
    assert button.get_attribute('aria-label') == 'show item 4'
    button.send_keys(Keys.ENTER)
    until(page, lambda: 'highest value of the converter' in text_of(page, '.marks'))
    # The other panel is that of the item at the slider.
    assert f'Saturation: {Reason.SATURATION.hint}' in text_of(page, '.signal')
    assert 'Saturation' not in text_of(page, '.item')


def test_whatever_moves_the_slider_shows_the_item_there(page: Chrome):
    slider = page.find_element(By.CSS_SELECTOR, '.slider')

    def choose_and(move: Callable[[], object], expected: int) -> None:
        """Choose item 2 in the list, then see where a move leads from there."""
        page.find_element(By.CSS_SELECTOR, '[aria-label="show item 2"]').send_keys(Keys.ENTER)
        shows(2)
        move()
        shows(expected)
        assert text_of(page, '.where').startswith(f'item {expected} of')
        until(page, lambda: 'show this item' not in text_of(page, '.signal'))

    def shows(number: int) -> None:
        until(page, lambda: text_of(page, '.signal .about').startswith(f'item {number} at'))

    slider.send_keys(Keys.END)
    shows(ITEMS)
    choose_and(lambda: press(page, 'show this item'), ITEMS)
    choose_and(lambda: press(page, 'previous item'), ITEMS - 1)
    choose_and(lambda: press(page, 'next item'), ITEMS)
    choose_and(lambda: press(page, 'previous fault'), 8)
    choose_and(lambda: slider.send_keys(Keys.ARROW_LEFT), 7)
    choose_and(lambda: press(page, 'next fault'), 8)


def test_everything_can_be_seen_and_has_a_name_at_any_width(page: Chrome):
    press(page, 'next fault')
    until(page, lambda: text_of(page, '.marks'))
    check_all_widths(page)
    assert errors_of(page) == []


def test_the_report_is_shown_and_nothing_in_it_runs(page: Chrome, port: int):
    answer = get(port, '/report')
    assert answer.status == 200
    assert 'sandbox' in answer.headers['Content-Security-Policy']
    assert page.find_element(By.LINK_TEXT, 'accuracy report').get_attribute('href')
    page.get(f'http://127.0.0.1:{port}/report')
    assert text_of(page, 'p') == 'accuracy'
    assert page.title != 'it ran'
    page.get(f'http://127.0.0.1:{port}/')
