# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a new line to a calibrated, tuned one that runs, by nothing but the page."""

from collections.abc import Callable
from pathlib import Path
import re

from browsers import errors_of, needs_browser, open_browser
from persons import Person, new_line
import pytest
import yaml

from checkweigher_production.audit_log import read_log

MASS, SPEED = 200.0, 60.0  # g, m/min; the speed is that of the machine after a new start, too
SENSITIVITY = 500_000  # counts per kg, of the machine
VALUES = {
    'driver': {'calibration.duration': 0.5, 'simulator.seed': 3},
    'dynamic_setting': {'estimator': 'tvlpf', 'budget': 4},
}


class Technician(Person):
    """Somebody who commissions a simulated machine."""

    def set_machine(self, *, feed: bool, load: str = '') -> None:
        """Set the switches of the machine, and what stands on its belt."""
        self.open('Simulated machine')
        box = '.dialog .q-checkbox'
        if (self.attribute(box, 'aria-checked') == 'true') != feed:
            self.until(lambda: self.clicked(box))
        self.fill('Belt speed (empty: as configured)', f'{SPEED:g}')
        self.fill('Mass of each product (empty: as configured)', f'{MASS:g}')
        self.fill('Mass that stands on the belt', load)
        self.press('Set')
        self.result('✓')
        self.close()

    def calibrate(self, button: str, load: float, done: Callable[[], object]) -> None:
        """Press a button of the calibration when a load has come to rest, until it is done."""
        self.open('Calibration')
        self.until(lambda: self.fits(load))
        self.fill('Mass', f'{MASS:g}')

        def pressed() -> bool:
            """Refused while the line has seen a product within two seconds."""
            self.press(button)
            self.until(lambda: done() or self.text('.dialog .result').startswith('✗'))
            return bool(done())

        self.until(pressed)
        self.close()

    def fits(self, load: float) -> bool:
        found = re.search(r'([-\d.]+) g', self.text('.dialog .load'))
        return found is not None and abs(float(found[1]) - load) < 1


@needs_browser
def test_a_new_line_is_calibrated_tuned_and_runs_by_the_page_alone(tmp_path: Path):
    with new_line(tmp_path, VALUES) as line, open_browser(tmp_path / 'browser') as browser:
        ben = Technician(browser, line)
        ben.log_in('ben')
        ben.until(lambda: 'FAULT' in ben.text('.decision'))  # there is no product yet

        ben.set_machine(feed=False)
        ben.calibrate('Read empty belt', 0, lambda: 'empty belt: r' in ben.text('.read'))
        ben.set_machine(feed=False, load=f'{MASS:g}')
        # What was read is there when the dialog is opened again.
        ben.calibrate('Read mass', MASS, lambda: 'empty belt: r' in ben.text('.read')
                      and f'{MASS:g} g: r' in ben.text('.read'))  # fmt: skip
        ben.set_machine(feed=False)
        ben.calibrate('Write calibration', 0, lambda: 'Residuals' in ben.text('.dialog .result'))
        cell = yaml.safe_load((line.folder / 'cell.yaml').read_text())['/**/driver']
        found = cell['ros__parameters']['simulator']['counts_per_kg']
        assert found == pytest.approx(SENSITIVITY, rel=0.01)  # read in half a second

        ben.set_machine(feed=True)
        ben.open('Dynamic setting')
        ben.press('Train')
        assert 'no passes' in ben.result('✗')
        ben.fill('Mass', f'{MASS:g}')
        ben.fill('Passes', '1000')
        ben.press('Record passes')
        ben.until(lambda: re.match(r'recording, (8|9|\d\d+) of', ben.text('.dialog .state')))
        ben.press('End recording')
        ben.until(lambda: 'of 1000 passes of 200 g recorded' in ben.text('.dialog .state'))
        ben.press('Train')
        ben.until(lambda: ben.text('.accuracy tbody').startswith('tvlpf'))
        trained = line.folder / 'machine.yaml'
        assert 'tvlpf' not in (trained.read_text() if trained.exists() else '')
        ben.press('Take over')
        ben.until(lambda: 'version 1' in ben.text('.dialog .result'))
        ben.until(lambda: not ben.text('.accuracy'))
        assert 'tvlpf' in trained.read_text()
        ben.press('Start the line again')
        ben.until(lambda: 'the line restarts' in ben.text('.dialog .result'))
        ben.close()
        # The line weighs by what was trained, and with the calibration.
        ben.until(lambda: 'tvlpf' in ben.text('[aria-label=Item] .about'))
        ben.until(lambda: 'FAULT' in ben.text('.decision'))
        # The line that has ended asked for a stop, the one in its place says that there is none.
        ben.until(lambda: not ben.text('.stop'))
        ben.does('Product', '✓', 'Select', choice='crisps_150g')
        ben.until(lambda: 'OVER' in ben.text('.decision'))
        assert line.noted('ben')[-1] == 'select product crisps_150g: done'
        kinds = [each.kind for each in read_log(line.folder / 'audit.log').entries]
        assert kinds.count('tuned') == 1
        assert errors_of(browser) == []
