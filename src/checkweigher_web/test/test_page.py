# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser, Debian's Chromium, on a line that runs."""

from collections.abc import Callable, Iterator
import subprocess
import sys

from browsers import (
    WIDTHS,
    errors_of,
    is_cut_off,
    needs_browser,
    open_browser,
    rows_of,
    shortcomings,
    text_of,
    until,
)
import pytest
import rclpy
from rclpy.node import Node
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from served_page import served
import yaml

pytestmark = needs_browser
LINE = {
    'driver': {'source': 'simulator', 'simulator': {'count': 0, 'seed': 3}},
    'reject': {'lower_limit': 0.1, 'upper_limit': 0.2},
}


@pytest.fixture(scope='module')
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Run an endless line and the page, and give the port."""
    params = tmp_path_factory.mktemp('line') / 'line.yaml'
    sections = {f'/**/{node}': {'ros__parameters': values} for node, values in LINE.items()}
    params.write_text(yaml.safe_dump(sections))
    words = [sys.executable, '-m', 'checkweigher_bringup.cli', 'run', '--params', str(params)]
    line = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    try:
        with served() as (_, found):
            yield found
    finally:
        line.terminate()
        line.wait()


@pytest.fixture(scope='module')
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    """Open a browser, once for all tests."""
    with open_browser(tmp_path_factory.mktemp('browser')) as driver:
        yield driver


def test_an_item_is_shown_with_mass_verdict_and_signal(browser: Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: len(rows_of(browser)) >= 6)
    # On a busy machine an item may have no mass in time.
    weighed = [row for row in rows_of(browser) if 'FAULT' not in row[-1]]
    number, _, mass, _, reference, verdict = weighed[0]
    assert int(number) > 0
    assert abs(float(mass) - float(reference)) < 1
    lower = {'OVER': 0.2e3, 'ACCEPT': 0.1e3}.get(verdict.split()[1], 0)
    assert float(mass) > lower
    until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
    assert text_of(browser, '.decision').split()[1] in ('ACCEPT', 'UNDER', 'OVER', 'FAULT')
    drawn = 'return document.querySelectorAll(".chart canvas").length'
    until(browser, lambda: browser.execute_script(drawn) == 6)
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


def test_everything_can_be_seen_and_has_a_name_at_any_width(browser: Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: len(rows_of(browser)) >= 1)
    right = 'return document.querySelector(arguments[0]).getBoundingClientRect().right'
    for width in WIDTHS:
        browser.set_window_size(width, 900)
        until(browser, lambda: not is_cut_off(browser))
        mass, panel = (browser.execute_script(right, each) for each in ('.mass', '.panel'))
        assert mass <= panel
        assert shortcomings(browser) == []


@pytest.fixture
def nodes() -> Iterator[Callable[[], list[str]]]:
    """Return what gives the names of the nodes in the graph."""
    rclpy.init()
    watcher = Node('watcher')
    yield watcher.get_node_names
    watcher.destroy_node()
    rclpy.try_shutdown()


def test_signals_are_taken_only_while_somebody_looks(
    browser: Chrome, port: int, nodes: Callable[[], list[str]]
):
    browser.get('about:blank')  # whichever test came before
    until(browser, lambda: 'page_results' in nodes())
    until(browser, lambda: 'page_signals' not in nodes())
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: 'page_signals' in nodes())
    browser.get('about:blank')
    until(browser, lambda: 'page_signals' not in nodes())
