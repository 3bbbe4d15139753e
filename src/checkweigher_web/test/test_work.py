# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Actions of users on a running line, on the page in a real browser."""

from pathlib import Path
import re

from browsers import errors_of, needs_browser, open_browser
from persons import SCRIPT, Person, Technician, new_line
from selenium.webdriver.common.by import By

from checkweigher_production.audit_log import read_log

EMPTY = 600.0  # duration in s of the empty belt before the first product


@needs_browser
def test_a_person_works_on_the_line_by_the_page_alone(tmp_path: Path):
    values = {'driver': {'simulator.lead_in': EMPTY, 'calibration.duration': 0.5}}
    products = {'crisps': {'nominal': 0.15}, SCRIPT: {'nominal': 0.2, 'reason': True}}
    with (
        new_line(tmp_path, values, products=products) as line,
        open_browser(tmp_path / 'browser') as browser,
    ):
        person = Technician(browser, line)
        person.log_in('anna')
        assert 'Commissioning' not in person.entries()
        assert re.search(r'zeroed at -?[\d.]+ g from', person.does('Zero', '✓'))
        # The driver publishes diagnostics once per second, so the page needs a moment.
        inactive = 'the driver is inactive'
        assert 'has stopped' in person.does('Stop', '✓')
        person.until(lambda: inactive in person.text('[aria-label=Diagnostics]'))
        person.until(lambda: 'Stop' not in person.buttons('.work'))
        assert 'has started' in person.does('Start', '✓')
        person.until(lambda: inactive not in person.text('[aria-label=Diagnostics]'))
        assert 'no stop was requested' in person.does('Reset stop', '✓', 'Reset')
        assert 'L1' in person.does('New batch', '✓', 'Begin', Batch='L1')
        assert 'not used before' in person.does('New batch', '✗', 'Begin', Batch='L1')
        # The product name is a script. Its recipe requires a reason for each later action.
        assert SCRIPT in person.does('Product', '✓', 'Select', choice=SCRIPT)
        person.log_out()
        used = "batch 'L1': a batch needs a name that was not used before"
        assert line.noted('anna') == [
            text
            for what, ending in (
                ('zero', 'done'),
                ('stop weighing', 'done'),
                ('start weighing', 'done'),
                ('reset stop request', 'done'),
                ('begin batch L1', 'done'),
                ('begin batch L1', f'refused: {used}'),
                (f'select product {SCRIPT}', 'done'),
            )
            for text in (f'{what}: asked from 127.0.0.1', f'{what}: {ending}')
        ]

        person.log_in('ben')
        person.commission('4 Limits')
        person.fill('Lower limit', '190')
        person.make('Set the limits')
        person.said('✗', 'reason')
        person.fill('Reason', 'test weights')
        person.make('Set the limits')
        person.said('✓', '190 g')
        person.fill('Upper limit', '100')
        person.make('Set the limits')
        person.said('✗', 'the lower limit, 190 g, is above the upper one, 100 g')
        entries = read_log(line.folder / 'audit.log').entries
        changed = [each for each in entries if each.subject.endswith('lower_limit')]
        assert (changed[-1].who, changed[-1].why) == ('ben', 'test weights')
        # New limits do not replace what a user has typed.
        commissioning = browser.current_window_handle
        browser.switch_to.new_window('tab')
        browser.get(f'http://127.0.0.1:{line.port}')
        assert 'crisps' in person.does('Product', '✓', 'Select', 'crisps', Reason='next product')
        browser.close()
        browser.switch_to.window(commissioning)
        person.until(lambda: '190 g' not in person.standing('4 Limits'))
        upper = browser.find_element(By.CSS_SELECTOR, '[aria-label^="Upper limit"]')
        assert upper.get_property('value') == '100'
        test = person.does('Performance test', '✗', 'Begin', Reason='shift')
        assert 'asks for no performance test' in test

        person.commission('2 Static')
        person.fill('Reason', 'new load cell')
        person.make('Read the load')
        person.said('✓ empty belt: ')
        # A reloaded page shows the earlier readings.
        browser.refresh()
        person.commission('2 Static')
        person.until(lambda: 'empty belt' in person.text('.stage.static tbody'))
        person.fill('Reason', 'new load cell')
        person.make('Begin again')
        person.until(lambda: not person.text('.stage.static tbody'))
        assert not (line.folder / 'cell.yaml').exists()
        assert 'set limits to 190 g and none: asked from 127.0.0.1; reason: test weights' in (
            line.noted('ben')
        )
        assert line.noted('ben')[-1] == 'forget what was read for a calibration: done'
        assert errors_of(browser) == []


@needs_browser
def test_a_stop_is_shown_until_it_is_reset(tmp_path: Path):
    # Only two items pass, so that no later item requests the stop again.
    values = {
        'driver': {'simulator.masses': [0.2], 'simulator.count': 2},
        'reject': {'max_rejects_in_a_row': 2},
    }
    with new_line(tmp_path, values) as line, open_browser(tmp_path / 'browser') as browser:
        person = Person(browser, line)
        person.log_in('anna')

        def stop() -> str:
            return person.text('.stop')

        person.until(lambda: stop().startswith('STOP TooManyRejects: '))
        assert 'TooManyRejects reset' in person.does('Reset stop', '✓', 'Reset')
        # The alarms of the stop and of the faults last until a user acknowledges them.
        person.until(lambda: 'stop TooManyRejects' in person.text('[aria-label=Alarms]'))
        assert '2 alarms ack' in person.does('Acknowledge alarms', '✓')
        person.until(lambda: '0 not acknowledged' in person.text('[aria-label=Alarms]'))
        assert re.search(r'over\s+stop TooManyRejects', person.text('[aria-label=Alarms]'))
        entry = [e for e in read_log(line.folder / 'audit.log').entries if e.kind == 'alarm'][-1]
        assert (entry.who, entry.new['acknowledged_by']) == ('anna', 'anna')
        person.until(lambda: not stop())
        browser.refresh()
        person.until(lambda: person.text('.decision') == 'FAULT')  # no product is selected
        assert not stop()
