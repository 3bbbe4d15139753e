# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Page of all lanes in a real browser, also with silent lanes and servers."""

from collections.abc import Iterator
from operator import itemgetter
import os
from pathlib import Path
import re
import signal
import socket

from axe import check_accessibility
from browsers import check_all_widths, errors_of, needs_browser, shortcomings, text_of, until
import pytest
from running import ROOT, start_command
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from served_page import child_of, line_of, served, write_parameters

pytestmark = needs_browser
RECIPES = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'
LINE = f"""
hosts: {{hall: 127.0.0.1}}
lanes:
  good: {{host: hall, params: good.yaml, recipes: {RECIPES}, product: crisps_150g}}
  ill: {{host: hall, params: ill.yaml}}
"""
VALUES: dict[str, dict[str, dict[str, object]]] = {
    'good': {'driver': {'simulator': {'count': 0, 'masses': [0.15]}}},
    # Each item is too heavy, so that the first item stops the line.
    'ill': {
        'driver': {'simulator': {'count': 0}},
        'reject': {'upper_limit': 0.01, 'max_rejects_in_a_row': 1},
    },
}
STATE, LANE, HOST, PRODUCT, RATE, ACCEPTED = range(6)
COUNTS = slice(ACCEPTED, ACCEPTED + 3)


@pytest.fixture(scope='module')
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    folder = tmp_path_factory.mktemp('line')
    for lane, nodes in VALUES.items():
        write_parameters(folder / f'{lane}.yaml', nodes)
    (folder / 'line.yaml').write_text(LINE)
    words = ('run', '--host', 'hall', '--line', folder / 'line.yaml')
    line = start_command(*words, stdout=None, stderr=None)
    try:
        with served() as (_, found):
            yield found
    finally:
        line.terminate()
        line.wait()


def lanes_of(browser: Chrome) -> list[list[str]]:
    return browser.execute_script(
        'return [...document.querySelectorAll(".lanes tbody tr")]'
        '.map(r => [...r.children].map(c => c.innerText))'
    )


def open_overview(browser: Chrome, port: int) -> list[list[str]]:
    """Open the page, wait until one lane weighs and the other has stopped, and return the rows."""
    browser.get(f'http://127.0.0.1:{port}/')

    def weighs() -> list[list[str]]:
        rows = lanes_of(browser)
        if len(rows) < 2:
            browser.get(f'http://127.0.0.1:{port}/')  # the page of a single lane was loaded
            return []
        good, ill = sorted(rows, key=itemgetter(LANE))
        # On a busy machine, the mass of an item may come too late.
        judged, named = sum(map(int, good[COUNTS])), good[PRODUCT] == 'crisps_150g'
        stopped = ill[STATE] == 'ERROR'
        return rows if stopped and judged > 2 and named and good[RATE] != '–' else []

    until(browser, weighs)
    return lanes_of(browser)


def test_each_lane_has_its_row_the_worst_first(browser: Chrome, port: int):
    rows = open_overview(browser, port)
    good, ill = sorted(rows, key=itemgetter(LANE))
    assert ill[STATE] == 'ERROR'
    # On a busy machine, a late verdict may also be an ERROR of the other lane.
    assert rows[0] == ill or good[STATE] == 'ERROR'
    assert '; ' in ill[-1]  # what to check
    assert good[LANE : PRODUCT + 1] == ['good', socket.gethostname(), 'crisps_150g']
    assert float(good[RATE]) > 0
    assert errors_of(browser) == []


def test_a_row_leads_to_its_lane_and_back(browser: Chrome, port: int):
    open_overview(browser, port)
    browser.find_element(By.LINK_TEXT, 'good').click()
    until(browser, lambda: text_of(browser, '.head .title') == 'lane good')
    until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
    until(browser, lambda: browser.find_element(By.LINK_TEXT, 'All lanes').is_displayed())
    browser.find_element(By.LINK_TEXT, 'All lanes').click()
    until(browser, lambda: len(lanes_of(browser)) == 2)


def test_everything_can_be_seen_at_any_width(browser: Chrome, port: int):
    open_overview(browser, port)
    check_all_widths(browser)
    check_accessibility(browser)
    assert all(all(row) for row in lanes_of(browser))


def test_a_page_waits_for_its_lane_and_tells_when_that_is_silent(browser: Chrome, tmp_path: Path):
    with served() as (_, port):
        browser.get(f'http://127.0.0.1:{port}/lane/late')
        until(browser, lambda: "no lane 'late' runs here" in text_of(browser, '.panel'))
        assert text_of(browser, '.head .title') == 'lane late'
        assert browser.find_element(By.LINK_TEXT, 'All lanes').is_displayed()
        assert shortcomings(browser) == []
        with line_of(tmp_path / 'late.yaml', VALUES['good'], '--namespace', 'late'):
            until(browser, lambda: 'ACCEPT' in text_of(browser, '.decision'))
            assert 'silent' not in text_of(browser, '.item')
        silent = r'silent for \d+ s, last item at \d\d:\d\d:\d\d'
        until(browser, lambda: re.search(silent, text_of(browser, '.item')))
        until(browser, lambda: browser.find_elements(By.CSS_SELECTOR, '.reading.NONE'))


def test_what_is_old_is_grey_and_says_since_when(browser: Chrome, tmp_path: Path):
    def note() -> str:
        return text_of(browser, 'body.stale .late')

    with line_of(tmp_path / 'line.yaml', VALUES['good']) as line, served() as (page, port):
        browser.get(f'http://127.0.0.1:{port}/lane/')  # earlier lanes may still exist
        until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
        until(browser, lambda: not note())
        silent = child_of(line.pid)
        for process, ending in ((silent, signal.SIGKILL), (page.pid, signal.SIGSTOP)):
            os.kill(process, signal.SIGSTOP)
            until(browser, lambda: re.match(r'No news since \d\d:\d\d:\d\d, for ', note()))
            assert shortcomings(browser) == []
            os.kill(process, ending)
            if process == silent:  # the launch restarts the process
                until(browser, lambda: not note())
        page.kill()
        page.wait()
        until(browser, note)
        with served('--port', str(port)):  # the browser finds the new server by itself
            until(browser, lambda: not note() and text_of(browser, '.mass').endswith(' g'))
