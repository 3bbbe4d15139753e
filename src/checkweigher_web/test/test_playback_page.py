# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Page of a recorded shift in a real browser, also by keys and at any width."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from axe import check_accessibility
from browsers import (
    check_all_widths,
    errors_of,
    is_at_rest,
    needs_browser,
    rows_of,
    text_of,
    until,
)
from lines import edges_of, saturated_at, simulated, without_edges
import pytest
from selenium.webdriver import ActionChains, Chrome
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
    until(browser, lambda: f'{ITEMS} items, {len(FAULTS)} faults' in text_of(browser, '.recording'))
    return browser


@pytest.fixture
def page(opened: Chrome) -> Chrome:
    """Return the page with its last item chosen and all items listed."""
    opened.set_window_size(1600, 1000)
    opened.refresh()
    until(opened, lambda: numbers(opened) == [*range(ITEMS, 0, -1)])
    until(opened, lambda: text_of(opened, '.where').startswith(f'item {ITEMS} of {ITEMS}'))
    return opened


def numbers(page: Chrome) -> list[int]:
    return [int(row[0]) for row in rows_of(page)]


def press(page: Chrome, text: str) -> None:
    page.find_element(By.XPATH, f'//button[normalize-space()="{text}"]').send_keys(Keys.ENTER)


def shows(page: Chrome, number: int) -> None:
    until(page, lambda: text_of(page, '.signal .about').startswith(f'item {number} at'))
    until(page, lambda: f'item {number}, ' in text_of(page, '.item .about'))
    assert text_of(page, '.where').startswith(f'item {number} of {ITEMS}')


def test_arrows_and_clicks_in_the_strip_move_through_the_items(page: Chrome):
    strip = page.find_element(By.CSS_SELECTOR, '.hour .chart')
    for key, number in ((Keys.ARROW_LEFT, ITEMS - 1), (Keys.HOME, 1), (Keys.ARROW_RIGHT, 2)):
        strip.send_keys(key)
        shows(page, number)
    until(page, lambda: text_of(page, '.mass').endswith(' g'))
    # A click at the right end of the figure chooses the last item.
    until(page, lambda: page.find_elements(By.CSS_SELECTOR, '.hour canvas'))
    until(page, lambda: is_at_rest(page, strip))
    right, top = strip.size['width'] // 2 - 24, 35 - strip.size['height'] // 2
    ActionChains(page).move_to_element_with_offset(strip, right, top).click().perform()
    shows(page, ITEMS)


def is_latest(shown: list[int]) -> bool:
    return shown == [*range(ITEMS, ITEMS - len(shown), -1)]


def test_a_part_of_the_time_that_is_selected_is_what_the_list_shows(page: Chrome):
    strip = page.find_element(By.CSS_SELECTOR, '.hour .chart')
    until(page, lambda: page.find_elements(By.CSS_SELECTOR, '.hour canvas'))
    page.execute_script('arguments[0].scrollIntoView({block: "center"})', strip)
    until(page, lambda: is_at_rest(page, strip))
    # Drag the left handle of the slider below the charts to the middle.
    left, bottom = 71 - strip.size['width'] // 2, strip.size['height'] // 2 - 18
    half = strip.size['width'] // 2 - 45
    drag = ActionChains(page).move_to_element_with_offset(strip, left, bottom).click_and_hold()
    drag.move_by_offset(half // 2, 0).move_by_offset(half - half // 2, 0).release().perform()
    until(page, lambda: 0 < len(shown := numbers(page)) < ITEMS and is_latest(shown))
    press(page, 'whole time')
    until(page, lambda: len(numbers(page)) == ITEMS)


def test_a_fault_opens_its_signal_with_what_broke(page: Chrome):
    expected = {8: 'outfeed eye: t3 is missing', 4: 'highest value of the converter'}
    for number, text in expected.items():
        press(page, 'previous fault')
        shown = partial(text_of, page, '.marks')
        until(page, lambda text=text, shown=shown: text in shown())
        shows(page, number)
        until(page, lambda: text_of(page, '.decision') == 'FAULT')
    press(page, 'previous fault')
    until(page, lambda: 'no fault before it' in text_of(page, 'body'))


def test_the_filter_lists_the_faults_alone_and_arrows_lead_through_the_list(page: Chrome):
    page.find_element(By.CSS_SELECTOR, '[role=checkbox]').send_keys(Keys.SPACE)
    until(page, lambda: numbers(page) == [8, 4])
    for row in rows_of(page):
        assert row[-1].split() == ['✗', 'FAULT', FAULTS[int(row[0])]]
    stops = page.find_elements(By.CSS_SELECTOR, '.items tbody button[tabindex="0"]')
    assert [stop.get_attribute('aria-label') for stop in stops] == ['show item 8']
    stops[0].send_keys(Keys.ARROW_DOWN)
    page.switch_to.active_element.send_keys(Keys.ENTER)
    until(page, lambda: 'highest value of the converter' in text_of(page, '.marks'))
    assert f'Saturation: {Reason.SATURATION.hint}' in text_of(page, '.signal')
    press(page, 'show the latest item')
    until(page, lambda: text_of(page, '.signal .about').startswith('item 8 at'))


def test_everything_can_be_seen_and_has_a_name_at_any_width(page: Chrome):
    press(page, 'previous fault')
    until(page, lambda: text_of(page, '.marks'))
    check_all_widths(page)
    check_accessibility(page)
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
