# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Accessibility of the login, a lane, dialogs and commissioning. Other tests check other pages."""

from pathlib import Path

from axe import check_accessibility
from browsers import needs_browser, open_browser
from persons import Technician, new_line
import pytest
from selenium.webdriver.common.by import By

from checkweigher_web.commissioning.registry import STEPS

VALUES = {
    'driver': {'simulator.masses': [0.15], 'simulator.seed': 3},
    'reject': {'max_rejects_in_a_row': 10},
}


@needs_browser
@pytest.mark.parametrize('all_pages', [False, pytest.param(True, marks=pytest.mark.soak)])
def test_no_page_has_a_serious_finding_in_either_theme(tmp_path: Path, all_pages: bool):
    products = {'crisps': {'nominal': 0.15}}
    with (
        new_line(tmp_path, VALUES, products=products) as line,
        open_browser(tmp_path / 'browser') as browser,
    ):
        browser.get(f'http://127.0.0.1:{line.port}/login')
        check_accessibility(browser)
        ben = Technician(browser, line)
        ben.log_in('ben')
        # Each item is a fault, because no product is selected, and so the line stops.
        ben.until(lambda: 'FAULT' in ben.text('.decision') and ben.text('.stop'))
        ben.until(lambda: 'TooManyRejects' in ben.text('[aria-label=Alarms]'))
        ben.until(lambda: browser.find_elements(By.CSS_SELECTOR, '.items tbody tr'))
        check_accessibility(browser)
        if not all_pages:
            ben.open('Recipes')
            check_accessibility(browser)
            return

        ben.open('Product')
        ben.choose('crisps')
        check_accessibility(browser)
        ben.press('Select')
        ben.result('✓')
        ben.close()
        ben.until(lambda: ben.text('.decision') == 'ACCEPT')
        check_accessibility(browser)
        ben.open_menu()
        check_accessibility(browser)
        browser.refresh()
        for name, chosen in (('Recipes', 'crisps'), ('Users', 'anna'), ('Audit log', '')):
            ben.open(name)
            if chosen:
                ben.until(lambda row=chosen: ben.clicked('.dialog .choices button', row))
            check_accessibility(browser)
            ben.close()

        for number, step in enumerate(STEPS, 1):
            ben.commission(f'{number} {step.title}')
            check_accessibility(browser)
