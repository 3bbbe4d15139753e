# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recipes, users and practice machine on the page of a technician, in a real browser."""

from pathlib import Path
import re

from browsers import check_all_widths, errors_of, needs_browser, open_browser, shortcomings
from persons import PASSWORD, Person, new_line

from checkweigher_production.recipes import given_recipes
from checkweigher_web.access.users import Role, read_users

PRODUCTS = {'crisps': {'nominal': 0.15, 'speed': [0.5, 1.5]}, 'nuts': {'nominal': 0.2}}
FILE = '# of the spring\nproducts:\n  peas: {nominal: 0.3}\n'
SEND = """
const input = document.querySelector('.dialog input[type=file]'), files = new DataTransfer();
files.items.add(new File([arguments[0]], 'recipes.yaml'));
input.files = files.files;
input.dispatchEvent(new Event('change'));
"""


class Technician(Person):
    """Somebody who sets up a simulated machine."""

    def choose_row(self, name: str) -> None:
        self.until(lambda: self.clicked('.dialog .choices button', name))
        self.until(lambda: self.text('.dialog .choices tr.chosen button') == name)

    def confirm(self, title: str) -> None:
        """Confirm a dialog above another one, and close it when its action is done."""
        dialog, verb = f'[aria-label="{title}"]', title.partition(' ')[0]
        self.until(lambda: self.clicked(f'{dialog} button', verb))
        self.until(lambda: self.text(f'{dialog} .result').startswith('✓'))
        self.until(lambda: self.clicked(f'{dialog} button', 'Close'))
        self.until(lambda: not self.text(dialog))


@needs_browser
def test_a_technician_changes_recipes_and_users_and_makes_a_fault(tmp_path: Path):
    values = {'driver': {'simulator.masses': [0.15], 'simulator.seed': 3}}
    with (
        new_line(tmp_path, values, products=PRODUCTS) as line,
        open_browser(tmp_path / 'browser') as browser,
    ):
        anna = Technician(browser, line)
        anna.log_in('anna')
        assert not {'Recipes', 'Users'} & set(anna.entries())
        anna.until(lambda: anna.text('.decision') == 'FAULT')  # no product is selected
        assert not anna.text('.practice')
        anna.log_out()

        ben, recipes = Technician(browser, line), line.folder / 'recipes.yaml'
        ben.log_in('ben')
        ben.open('Recipes')
        ben.choose_row('crisps')
        ben.fill('Upper limit', '140')
        ben.press('Save')
        assert 'crisps.upper_limit: 140 g is below nominal, 150 g' in ben.result('✗')
        ben.fill('Upper limit', '160')
        ben.fill('Reason', 'new film')
        ben.press('Save')
        assert 'crisps is saved' in ben.result('✓')
        assert given_recipes(recipes)['crisps'] == {**PRODUCTS['crisps'], 'upper_limit': 0.16}
        assert shortcomings(browser) == []
        assert all(ben.fits(width) for width in (390, 1000, 1600))
        ben.choose_row('nuts')
        ben.press('Remove')
        ben.confirm('Remove recipe')
        assert list(given_recipes(recipes)) == ['crisps']
        browser.execute_script(SEND, FILE)
        ben.press('Import')
        ben.confirm('Import recipes')
        assert recipes.read_text() == FILE
        ben.close()

        ben.open('Users')
        ben.fill('Name', 'carla')
        ben.until(lambda: ben.clicked('.dialog .q-select'))
        ben.until(lambda: ben.clicked('.q-menu .q-item', 'operator'))
        for label in ('New password', 'The same again'):
            ben.fill(label, PASSWORD)
        ben.press('Add')
        ben.result('✓')
        ben.choose_row('ben')
        ben.press('Remove')
        assert 'your own account' in ben.result('✗')
        assert shortcomings(browser) == []
        ben.choose_row('vera')
        ben.press('Remove')
        ben.confirm('Remove user')
        ben.close()
        known = read_users(tmp_path / 'users')
        assert list(known) == ['anna', 'ben', 'carla']
        assert known['carla'].role is Role.OPERATOR
        assert known['carla'].has_password(PASSWORD)

        ben.does('Product', '✓', 'Select', choice='peas')
        ben.until(lambda: ben.text('.decision') == 'ACCEPT')
        assert 'NoProduct' not in ben.text('.reading .why')
        ben.until(lambda: ben.clicked('.practice .eye .q-toggle'))
        ben.until(lambda: 'ChatteringEye' in ben.text('.item'))
        ben.until(lambda: 'ChatteringEye' in ben.text('[aria-label=Alarms]'))
        # A fault of all latest items is an error of the diagnostics, which the header counts.
        ben.until(lambda: re.search(r'\d+ errors?', ben.text('.head')))
        check_all_widths(browser)
        assert errors_of(browser) == []
        changed = 'upper_limit – → 0.16'
        asked = f'recipe crisps: {changed}: asked from 127.0.0.1; reason: new film'
        noted = line.noted('ben')
        assert asked in noted
        for done in (
            'recipe nuts: removed',
            'recipes imported: peas',
            'add user carla as operator',
            'remove user vera',
            'simulated machine: infeed_dirty True',
        ):
            assert f'{done}: done' in noted
        assert PASSWORD not in (line.folder / 'audit.log').read_text()
