# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Accessibility of a page in both themes by axe-core, and the size of its buttons."""

from importlib.resources import files

import axe_core_python
from running import PATIENCE
from selenium.webdriver import Chrome

_AXE = files(axe_core_python).joinpath('axe.min.js').read_text(encoding='utf-8')
_RUN = """
const [rules, done] = arguments;
const told = rule => rule.nodes.map(
  each => `${rule.id} (${rule.impact}) ${each.target.join(' ')}: ${each.failureSummary}`);
axe.run({resultTypes: ['violations'], ...rules})
  .then(found => done(found.violations
    .filter(rule => ['serious', 'critical'].includes(rule.impact)).flatMap(told)));
"""
# Buttons, links of the header, entries of a menu and fields of the login with less than 48 px.
_SMALL = """
const kinds = '.q-btn, .q-menu .q-item, .head :is(a, form button), .login :is(input, button)';
return [...document.querySelectorAll(kinds)]
  .filter(each => each.checkVisibility() && each.type !== 'hidden')
  .map(each => [each, each.getBoundingClientRect()])
  .filter(([, place]) => Math.round(Math.min(place.width, place.height)) < 48)
  .map(([each, place]) => `${place.width} x ${place.height} px: ${each.outerHTML.slice(0, 120)}`);
"""
# A colour in transition would be measured as it is at that moment.
_NO_TRANSITIONS = """
const style = new CSSStyleSheet();
style.replaceSync('* { transition: none !important }');
document.adoptedStyleSheets = [...document.adoptedStyleSheets, style];
"""
_SCHEME = 'prefers-color-scheme'
# Rules of axe-core for each theme. Only the colours differ between the themes.
_THEMES = {'light': {}, 'dark': {'runOnly': ['color-contrast']}}


def check_accessibility(driver: Chrome) -> None:
    """Check that axe-core finds nothing serious in either theme, and that buttons have 48 px."""
    found = list(driver.execute_script(_SMALL))
    driver.execute_script(_NO_TRANSITIONS)
    driver.execute_script(_AXE)
    driver.set_script_timeout(PATIENCE)
    for theme, rules in _THEMES.items():
        _set_media(driver, {'name': _SCHEME, 'value': theme})
        found += [f'{theme}: {each}' for each in driver.execute_async_script(_RUN, rules)]
    _set_media(driver)  # as before
    assert not found, '\n'.join(found)


def _set_media(driver: Chrome, *features: dict[str, str]) -> None:
    driver.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': list(features)})
