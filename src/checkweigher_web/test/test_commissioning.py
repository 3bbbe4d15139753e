# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning of a new line on the page, from zero to trained parameters."""

from pathlib import Path
import re

from browsers import errors_of, needs_browser, open_browser
from made_procedure import SHORT_PLAN
from persons import Technician, new_line
import pytest
from selenium.webdriver.common.by import By
import yaml

from checkweigher_production.audit_log import read_log

MASS, SPEED = 200.0, 60.0  # g, m/min; the simulated line has this speed after a restart, too
SENSITIVITY = 500_000  # counts/kg of the simulated load cell
VALUES = {
    'driver': {'calibration.duration': 0.5, 'simulator.seed': 3},
    'dynamic_setting': {'estimator': 'tvlpf', 'budget': 4},
}
_TO_THE_MIDDLE = 'document.querySelector(arguments[0]).scrollIntoView({block: "center"})'
# A press clears the result of the press before it, which is still shown until then.
_WATCH_RESULT = (
    'window.hasNewResult = false;'
    'new MutationObserver((_, watch) => { window.hasNewResult = true; watch.disconnect(); })'
    '.observe(document.querySelector(".foot .result"), {childList: true, characterData: true,'
    ' subtree: true});'
)


class Trainee(Technician):
    """Somebody who commissions a simulated machine."""

    def set_machine(self, label: str, value: str, what: str) -> None:
        """Change a field of the simulated machine, and wait until the line has done `what`."""
        self.fill(label, value)
        self.wait_for(what)

    def switch_feed(self, *, on: bool) -> None:
        """Start or stop the products of the simulated machine."""
        switch = '.machine > .q-toggle'

        def clicked() -> bool:
            if not self.text(switch):  # the page does not show the machine yet
                return False
            self.browser.execute_script(_TO_THE_MIDDLE, switch)  # away from the foot of the page
            return self.clicked(switch)

        self.until(clicked)
        self.wait_for(f'feed {on}')

    def value(self, label: str) -> str:
        """Return the text in a field of the simulated machine."""
        field = self.browser.find_element(By.CSS_SELECTOR, f'.machine input[aria-label="{label}"]')
        return str(field.get_property('value'))

    def wait_for(self, what: str) -> None:
        told = f'simulated machine: {what}: done'
        self.until(lambda: self.line.noted('ben')[-1:] == [told])

    def read(self, load: float) -> None:
        """Wait until a load is on the belt, and read the load when it is at rest."""
        self.until(lambda: self.fits(load))
        self.until_done('Read the load', f'{load:g} g: ' if load else 'empty belt: ')

    def until_done(self, button: str, word: str) -> None:
        """Press a button until the result contains `word`.

        The action is refused for some time after a product has passed.
        """

        def done() -> bool:
            self.browser.execute_script(_WATCH_RESULT)
            self.make(button)
            self.until(lambda: self.browser.execute_script('return window.hasNewResult'))
            self.until(lambda: self.text('.foot .result')[:1] in ('✓', '✗'))
            return word in self.text('.foot .result')

        self.until(done)

    def plan(self, path: Path, text: str) -> None:
        """Upload a verification plan, and wait until the page shows its duration."""
        self.commission('5 Verify')
        path.write_text(text)
        upload = self.browser.find_element(By.CSS_SELECTOR, '.verify input[type=file]')
        upload.send_keys(str(path))
        self.until(lambda: re.search(r'Steps: 9, .* \(as recorded\)', self.text('.verify .found')))

    def fits(self, load: float) -> bool:
        found = re.search(r'([-\d.]+) g', self.text('.now .load'))
        return found is not None and abs(float(found[1]) - load) < 1


@needs_browser
def test_a_new_line_is_calibrated_tuned_and_runs_by_the_page_alone(tmp_path: Path):
    with new_line(tmp_path, VALUES) as line, open_browser(tmp_path / 'browser') as browser:
        ben = Trainee(browser, line)
        ben.log_in('ben')
        ben.until(lambda: 'FAULT' in ben.text('.decision'))  # no product is selected yet
        ben.until(lambda: 'This machine was not trained' in ben.text('.hint'))
        ben.until(lambda: ben.clicked('.hint a', 'Commissioning'))
        ben.until(lambda: ben.text('.path'))

        ben.commission('1 Zero')
        ben.switch_feed(on=False)
        ben.set_machine('Belt speed', f'{SPEED:g}', f'speed {SPEED / 60}')
        ben.set_machine('Mass of each product', f'{MASS:g}', f'mass {MASS / 1000}')
        ben.until_done('Set the zero', 'zeroed at')
        ben.until(lambda: '✓' in ben.standing('1 Zero'))
        ben.make('Next: Static')
        ben.until(lambda: ben.text('.stage.static'))
        ben.make('Read the load')
        ben.said('✓ empty belt: ')
        ben.set_machine('Mass that lies on the belt', f'{MASS:g}', f'load {MASS / 1000}')
        ben.fill('Mass on the belt', f'{MASS:g}')
        ben.read(MASS)
        browser.refresh()  # a reloaded page shows the earlier readings
        ben.commission('2 Static')
        ben.until(lambda: ben.text('.stage.static tbody').startswith('empty belt'))
        ben.set_machine('Mass that lies on the belt', '', 'load 0.0')
        ben.until_done('Write calibration', 'Deviations')
        cell = yaml.safe_load((line.folder / 'cell.yaml').read_text())['/**/driver']
        found = cell['ros__parameters']['simulator']['counts_per_kg']
        assert found == pytest.approx(SENSITIVITY, rel=0.01)  # each reading takes 0.5 s

        ben.commission('3 Dynamic')
        ben.switch_feed(on=True)
        ben.fill('Mass of the product', f'{MASS:g}')
        ben.fill('Passes', '1000')
        ben.make('Record passes')
        ben.until(lambda: re.match(r'(8|9|\d\d+) of 1000 passes', ben.text('.foot .request')))
        ben.make('End')
        ben.said('of 1000 passes of 200 g recorded')
        ben.until(lambda: ' passes of 200 g at 60 m/min' in ben.text('.dynamic .lines'))
        ben.until(lambda: 'The plan of Verify begins with' in ben.text('.dynamic .doubts'))
        ben.commission('5 Verify')
        ben.until(lambda: '200g: certificate' in ben.text('.verify .doubts'))
        ben.plan(tmp_path / 'heavier.yaml', SHORT_PLAN.replace('194.5', '590'))
        browser.refresh()  # a reloaded page has the plan that was edited last
        ben.commission('3 Dynamic')
        ben.until(lambda: 'recorded passes: 590 g at 60 m/min' in ben.text('.dynamic .doubts'))
        assert ben.text('.foot > button') == 'Record passes'
        ben.plan(tmp_path / 'plan.yaml', SHORT_PLAN)  # of two masses at this speed
        ben.commission('3 Dynamic')
        ben.until(lambda: ben.text('.foot > button') == 'Train')
        assert ben.text('.dynamic .doubts') == ''
        ben.make('Train')
        ben.until(lambda: ben.text('.accuracy tbody').startswith('tvlpf'))
        assert 'not taken over yet' in ben.standing('3 Dynamic')
        trained = line.folder / 'machine.yaml'
        assert 'tvlpf' not in (trained.read_text() if trained.exists() else '')
        ben.make('Take over')
        ben.said('taken over')
        assert 'tvlpf' in trained.read_text()
        browser.refresh()  # a reloaded page knows that the line must be started again
        ben.commission('3 Dynamic')
        ben.until(lambda: 'start the line again' in ben.standing('3 Dynamic'))
        assert '✓' not in ben.standing('3 Dynamic')
        ben.make('Start the line again')
        ben.said('the line restarts')
        # The new driver has the settings of the configuration.
        ben.until(lambda: not ben.value('Mass of each product'))
        ben.until(lambda: '✓' in ben.standing('3 Dynamic'))

        ben.commission('4 Limits')
        ben.until(lambda: 'no product is selected' in ben.standing('4 Limits'))
        browser.get(f'http://127.0.0.1:{line.port}/')
        # The line uses the trained parameters and the calibration.
        ben.until(lambda: 'tvlpf' in ben.text('[aria-label=Item] .about'))
        ben.until(lambda: not ben.text('.hint'))
        ben.until(lambda: 'FAULT' in ben.text('.decision'))
        # The line that ended requested a stop, and the new line withdraws the request.
        ben.until(lambda: not ben.text('.stop'))
        ben.commission('4 Limits')
        assert not ben.text('.stage.limits .fields')  # limits come with the product
        ben.until(lambda: ben.clicked('.stage.limits .q-select'))
        ben.until(lambda: ben.clicked('.q-menu .q-item', 'crisps_150g'))
        ben.make('Select')
        ben.said('✓', 'crisps_150g')
        ben.until(lambda: ben.text('.stage.limits .fields'))
        assert '✓' in ben.standing('4 Limits')
        primary = browser.find_element(By.CSS_SELECTOR, '.foot > button')
        for text, can_be_set in (('180', True), ('169', False)):  # the limit in use is 169 g
            ben.fill('Upper limit', text)
            ben.until(lambda: primary.is_enabled() == can_be_set)  # noqa: B023
        assert primary.text == 'Set the limits'
        assert line.noted('ben')[-1] == 'select product crisps_150g: done'
        browser.get(f'http://127.0.0.1:{line.port}/')
        ben.until(lambda: 'OVER' in ben.text('.decision'))
        kinds = [each.kind for each in read_log(line.folder / 'audit.log').entries]
        assert kinds.count('tuned') == 1
        assert errors_of(browser) == []
