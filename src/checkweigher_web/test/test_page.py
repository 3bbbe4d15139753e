# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser, Debian's Chromium, on a line that runs."""

from collections.abc import Callable, Iterator
from pathlib import Path
import shutil
import subprocess
import sys

import pytest
import rclpy
from rclpy.node import Node
from running import PATIENCE
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.wait import WebDriverWait
from served_page import served
import yaml

BROWSER, DRIVER = shutil.which('chromium'), shutil.which('chromedriver')
pytestmark = pytest.mark.skipif(
    not (BROWSER and DRIVER),
    reason='no chromium and chromedriver: the page was not tested in a browser',
)
OPTIONS = (
    '--headless=new', '--no-sandbox', '--disable-gpu', '--no-first-run', '--disable-sync',
    '--disable-background-networking', '--disable-component-update',
)  # fmt: skip
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


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[webdriver.Chrome]:
    options = Options()
    options.binary_location = str(BROWSER)
    for option in (*OPTIONS, f'--user-data-dir={tmp_path}'):
        options.add_argument(option)
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    yield driver
    driver.quit()


def until(browser: webdriver.Chrome, condition: Callable[[], object]) -> object:
    return WebDriverWait(browser, PATIENCE, poll_frequency=0.1).until(lambda _: condition())


def text_of(browser: webdriver.Chrome, selector: str) -> str:
    return str(browser.execute_script(  # in one step: the page changes
        'return document.querySelector(arguments[0])?.innerText ?? ""', selector))  # fmt: skip


def rows_of(browser: webdriver.Chrome) -> list[list[str]]:
    return browser.execute_script(
        'return [...document.querySelectorAll(".items tbody tr")]'
        '.map(r => [...r.children].map(c => c.innerText))'
    )


def test_an_item_is_shown_with_mass_verdict_and_signal(browser: webdriver.Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: len(rows_of(browser)) >= 6)
    # On a busy machine an item may have no mass in time.
    weighed = [row for row in rows_of(browser) if not row[-1]]
    number, _, mass, _, reference, verdict, _ = weighed[0]
    assert int(number) > 0
    assert abs(float(mass) - float(reference)) < 1
    lower = {'OVER': 0.2e3, 'ACCEPT': 0.1e3}.get(verdict.split()[1], 0)
    assert float(mass) > lower
    until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
    assert text_of(browser, '.decision').split()[1] in ('ACCEPT', 'UNDER', 'OVER', 'FAULT')
    drawn = 'return document.querySelectorAll(".chart canvas").length'
    until(browser, lambda: browser.execute_script(drawn) == 6)
    errors = [entry for entry in browser.get_log('browser') if entry['level'] == 'SEVERE']
    assert not errors


def test_an_item_can_be_chosen_with_the_keyboard_alone(browser: webdriver.Chrome, port: int):
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: len(rows_of(browser)) >= 3)
    button = browser.find_elements(By.CSS_SELECTOR, '.items tbody button')[2]
    name = str(button.get_attribute('aria-label'))
    button.send_keys(Keys.ENTER)
    chosen = 'tr.chosen button'
    until(browser, lambda: browser.find_elements(By.CSS_SELECTOR, chosen))
    label = 'return document.querySelector(arguments[0])?.ariaLabel'
    assert browser.execute_script(label, chosen) == name


@pytest.mark.parametrize('width', [375, 800, 1600])
def test_nothing_is_cut_off_at_any_width(browser: webdriver.Chrome, port: int, width: int):
    browser.set_window_size(width, 900)
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: len(rows_of(browser)) >= 1)
    inside = 'return document.documentElement.scrollWidth <= window.innerWidth'
    assert browser.execute_script(inside)
    panel, mass = (
        browser.execute_script(
            'return document.querySelector(arguments[0]).getBoundingClientRect().right', selector
        )
        for selector in ('.panel', '.mass')
    )
    assert mass <= panel


@pytest.fixture
def nodes() -> Iterator[Callable[[], list[str]]]:
    """Return what gives the names of the nodes in the graph."""
    rclpy.init()
    watcher = Node('watcher')
    yield watcher.get_node_names
    watcher.destroy_node()
    rclpy.try_shutdown()


def test_signals_are_taken_only_while_somebody_looks(
    browser: webdriver.Chrome, port: int, nodes: Callable[[], list[str]]
):
    until(browser, lambda: 'page_results' in nodes())
    until(browser, lambda: 'page_signals' not in nodes())
    browser.get(f'http://127.0.0.1:{port}/')
    until(browser, lambda: 'page_signals' in nodes())
    browser.get('about:blank')
    until(browser, lambda: 'page_signals' not in nodes())
