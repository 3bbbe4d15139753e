# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Debian's Chromium, headless, on a page of this machine, and what a person must be able to see."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
import shutil

import pytest
from running import PATIENCE
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException, TimeoutException
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.wait import WebDriverWait

BROWSER, DRIVER = shutil.which('chromium'), shutil.which('chromedriver')
needs_browser = pytest.mark.skipif(
    not (BROWSER and DRIVER),
    reason='no chromium and chromedriver: the page was not tested in a browser',
)
_OPTIONS = (
    '--headless=new', '--no-sandbox', '--disable-gpu', '--no-first-run', '--disable-sync',
    '--disable-background-networking', '--disable-component-update', '--hide-scrollbars',
    '--force-prefers-reduced-motion',
)  # fmt: skip
WIDTHS = (375, 800, 1600)  # px: a phone, a tablet, a desk

# Contrast as of WCAG 2.2, 1.4.3: of text on what is painted behind it, 4.5 or of large text 3 to 1.
_POOR_CONTRASTS = """
const parse = text => (text.match(/[\\d.]+/g) || []).map(Number);
const over = (top, under) => {
  const a = top[3] ?? 1;
  return [0, 1, 2].map(k => a * top[k] + (1 - a) * under[k]);
};
const behind = element => {
  const painted = [];
  for (let e = element; e; e = e.parentElement) {
    const color = parse(getComputedStyle(e).backgroundColor);
    painted.push(color);
    if ((color[3] ?? 1) === 1) break;
  }
  return painted.reverse().reduce((under, top) => over(top, under), [255, 255, 255]);
};
const luminance = color => {
  const [r, g, b] = color.slice(0, 3).map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  const element = walker.currentNode.parentElement, text = walker.currentNode.data.trim();
  const seen = element.checkVisibility({opacityProperty: true, visibilityProperty: true});
  if (!text || !seen) continue;
  if (element.closest('script, style, [aria-hidden=true], [aria-disabled=true]')) continue;
  const style = getComputedStyle(element), back = behind(element);
  const [x, y] = [luminance(over(parse(style.color), back)), luminance(back)];
  const ratio = (Math.max(x, y) + 0.05) / (Math.min(x, y) + 0.05);
  const size = parseFloat(style.fontSize), bold = Number(style.fontWeight) >= 700;
  const least = size >= 24 || (bold && size >= 18.66) ? 3 : 4.5;
  if (ratio < least) found.push(`${ratio.toFixed(2)} of ${least}: ${text}`);
}
return found;
"""
# Controls that a screen reader would call by nothing but their kind.
_UNLABELLED = """
const named = e => (e.getAttribute('aria-label') || e.innerText || e.title || e.alt || '').trim()
  || [...(e.labels || [])].some(l => l.innerText.trim())
  || (e.getAttribute('aria-labelledby') || '').split(/\\s+/)
       .some(id => id && document.getElementById(id)?.innerText.trim());
const kinds = 'a[href], button, input, select, textarea, [role=button], [role=slider], '
  + '[role=checkbox], [role=switch], [role=img], [role=dialog], [role=region], section';
return [...document.querySelectorAll(kinds)]
  .filter(e => e.checkVisibility() && e.type !== 'hidden' && !e.closest('[aria-hidden=true]'))
  // What takes no focus is a part of a control that is named itself.
  .filter(e => !(e.tabIndex < 0 && e.parentElement.closest('[role], label')))
  .filter(e => !named(e)).map(e => e.outerHTML.slice(0, 120));
"""

# Whether an element keeps its place for 0.1 s: a click while the layout moves falls elsewhere.
_IS_AT_REST = (
    'const [element, done] = arguments;'
    'const place = () => JSON.stringify(element.getBoundingClientRect()), before = place();'
    'setTimeout(() => done(place() === before), 100);'
)


@contextmanager
def open_browser(folder: Path, *more: str) -> Iterator[webdriver.Chrome]:
    """Open a browser with its files in a folder; `more` are options of its command line."""
    options = Options()
    options.binary_location = str(BROWSER)
    for option in (*_OPTIONS, *more, f'--user-data-dir={folder}'):
        options.add_argument(option)
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    try:
        yield driver
    finally:
        driver.quit()


def until(driver: webdriver.Chrome, condition: Callable[[], object]) -> object:
    """Wait until a condition holds, and return what it gave; tell what is seen if it never does."""
    try:
        # An element may be drawn anew between its search and its use.
        drawn_anew = [StaleElementReferenceException]
        wait = WebDriverWait(driver, PATIENCE, 0.2, ignored_exceptions=drawn_anew)
        return wait.until(lambda _: condition())
    except TimeoutException:
        log = [each['message'] for each in driver.get_log('browser')]
        seen = f'{driver.current_url}, log {log}: {text_of(driver, "body")}'
        raise AssertionError(seen) from None


def text_of(driver: webdriver.Chrome, selector: str) -> str:
    """Return the text that a person sees of the first element of a selector, '' without one."""
    return str(driver.execute_script(  # in one step: the page changes
        'const found = document.querySelector(arguments[0]);'
        'return found?.checkVisibility() ? found.innerText : ""', selector))  # fmt: skip


def is_at_rest(driver: webdriver.Chrome, element: WebElement) -> bool:
    """Return whether an element keeps its place on the page for 0.1 s."""
    return bool(driver.execute_async_script(_IS_AT_REST, element))


def rows_of(driver: webdriver.Chrome) -> list[list[str]]:
    """Return the texts of the list of items."""
    return driver.execute_script(
        'return [...document.querySelectorAll(".items tbody tr")]'
        '.map(r => [...r.children].map(c => c.innerText))'
    )


def errors_of(driver: webdriver.Chrome) -> list[str]:
    """Return what the browser complained of."""
    return [each['message'] for each in driver.get_log('browser') if each['level'] == 'SEVERE']


def shortcomings(driver: webdriver.Chrome) -> list[str]:
    """Return texts of too little contrast and controls without a name on what is shown."""
    found: list[str] = []
    for script in (_POOR_CONTRASTS, _UNLABELLED):
        found += driver.execute_script(script)
    return found


def check_all_widths(driver: webdriver.Chrome) -> None:
    """Check at each width that all is seen, has enough contrast and has a name."""
    for width in WIDTHS:
        driver.set_window_size(width, 900)
        until(driver, lambda: not is_cut_off(driver))
        found = shortcomings(driver)
        assert not found, (width, found)  # pytest rewrites asserts of test modules alone


def is_cut_off(driver: webdriver.Chrome) -> bool:
    """Tell whether the page is wider than its window, or a part of it than its frame."""
    inside = (
        'return document.documentElement.scrollWidth <= window.innerWidth && '
        '[...document.querySelectorAll(".panel")].every(p => p.scrollWidth <= p.clientWidth + 1)'
    )
    return not driver.execute_script(inside)
