# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A person works on a running line by the page alone, in a real browser."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import re
import subprocess
import sys

from browsers import needs_browser, open_browser
from persons import SCRIPT, Person, new_line, running_line
import yaml

from checkweigher_production.audit_log import read_log

EMPTY = 600.0  # s, of the simulated belt before the first product


@contextmanager
def dynamic_setting(folder: Path) -> Iterator[None]:
    """Run the node beside a line, which trains little."""
    values = {'folder': folder, 'estimator': 'tvlpf', 'budget': 4}
    words = [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]
    module = 'checkweigher_bringup.commissioning.dynamic_setting'
    node = subprocess.Popen([sys.executable, '-m', module, '--ros-args', *words])
    try:
        yield
    finally:
        node.terminate()
        node.wait()


@needs_browser
def test_a_person_works_on_the_line_by_the_page_alone(tmp_path: Path):
    empty = {'simulator.lead_in': EMPTY}
    with running_line(tmp_path, **empty) as line, open_browser(tmp_path) as browser:
        person = Person(browser, line)
        person.log_in('vera')
        assert not person.buttons('.work')
        person.log_out()

        person.log_in('anna')
        assert 'Calibration' not in person.buttons('.work')
        assert re.search(r'zeroed at -?[\d.]+ g from', person.does('Zero', '✓'))
        # The diagnostics come from the driver, once a second.
        inactive = 'the driver is inactive'
        assert 'has stopped' in person.does('Stop', '✓')
        person.until(lambda: inactive in person.text('[aria-label=Diagnostics]'))
        assert 'driver refused' in person.does('Stop', '✗')
        assert 'has started' in person.does('Start', '✓')
        person.until(lambda: inactive not in person.text('[aria-label=Diagnostics]'))
        assert 'no stop was requested' in person.does('Reset stop', '✓', 'Reset')
        person.open('New batch')
        person.fill('Batch', 'L1')
        person.press('Begin')
        assert 'L1' in person.result('✓')
        person.close()
        person.open('New batch')
        person.fill('Batch', 'L1')
        person.press('Begin')
        assert 'not used before' in person.result('✗')
        person.close()
        # A recipe whose name is a script, and which asks for a reason from then on.
        person.open('Product')
        person.choose(SCRIPT)
        person.press('Select')
        assert SCRIPT in person.result('✓')
        person.close()
        person.log_out()
        assert line.noted('anna') == [
            'zero: asked from 127.0.0.1', 'zero: done',
            'stop weighing: asked from 127.0.0.1', 'stop weighing: done',
            'stop weighing: asked from 127.0.0.1',
            'stop weighing: refused: driver refused; see Diagnostics',
            'start weighing: asked from 127.0.0.1', 'start weighing: done',
            'reset stop request: asked from 127.0.0.1', 'reset stop request: done',
            'begin batch L1: asked from 127.0.0.1', 'begin batch L1: done',
            'begin batch L1: asked from 127.0.0.1',
            "begin batch L1: refused: batch 'L1': a name that was not used before is needed",
            f'select product {SCRIPT}: asked from 127.0.0.1', f'select product {SCRIPT}: done',
        ]  # fmt: skip

        person.log_in('ben')
        person.open('Limits')
        person.fill('Lower limit', '190')
        person.press('Set')
        assert 'reason' in person.result('✗')
        person.fill('Reason', 'test weights')
        person.press('Set')
        assert '190 g' in person.result('✓')
        person.close()
        person.open('Limits')
        person.until(lambda: person.units() == [True, True])  # the dialog has opened
        person.fill('Upper limit', '100')
        person.fill('Reason', 'test weights')
        person.press('Set')
        assert 'the lower limit, 190 g, is above the upper one, 100 g' in person.result('✗')
        person.close()
        entries = read_log(tmp_path / 'audit.log').entries
        changed = [each for each in entries if each.subject.endswith('lower_limit')]
        assert (changed[-1].who, changed[-1].why) == ('ben', 'test weights')
        person.open('Performance test')
        person.fill('Reason', 'shift')
        person.press('Begin')
        assert 'asks for no performance test' in person.result('✗')
        person.close()

        person.open('Calibration')
        person.until(lambda: person.units() == [True, True, True])
        person.fill('Reason', 'new load cell')
        person.press('Write calibration')
        assert 'no load was read' in person.result('✗')
        person.press('Read empty belt')
        person.until(lambda: 'empty belt: reading' in person.text('.read'))
        # Nobody puts a mass on a simulated belt: it reads as if it were empty.
        person.fill('Mass', '200')
        person.press('Read mass')
        person.until(lambda: '200 g: reading' in person.text('.read'))
        person.press('Write calibration')
        person.result('✗')
        assert not (line.folder / 'cell.yaml').exists()
        # The browser loses its page, dialog and all: what was read is there when it comes back.
        browser.refresh()
        person.until(lambda: 'Calibration' in person.buttons('.work'))
        person.open('Calibration')
        person.until(lambda: '200 g: reading' in person.text('.read'))
        person.fill('Reason', 'new load cell')
        person.press('Begin again')
        person.until(lambda: not person.text('.read'))
        person.press('Read empty belt')
        person.until(lambda: 'empty belt: reading' in person.text('.read'))
        person.press('Write calibration')
        person.until(lambda: 'Residuals: 0 g' in person.text('.dialog .result'))
        values = yaml.safe_load((line.folder / 'cell.yaml').read_text())
        assert 'zero_counts' in values['/**/driver']['ros__parameters']['simulator']
        assert 'set limits to 190 g and none: asked from 127.0.0.1; reason: test weights' in (
            line.noted('ben')
        )
        assert line.noted('ben')[-1] == 'write calibration: done'
        severe = [entry for entry in browser.get_log('browser') if entry['level'] == 'SEVERE']
        assert not severe


@needs_browser
def test_a_stop_is_shown_until_it_is_reset(tmp_path: Path):
    # After the second item nothing passes any more, so nothing asks for the stop again.
    values = {
        'driver': {'simulator.masses': [0.2], 'simulator.count': 2},
        'reject': {'upper_limit': 0.1, 'max_rejects_in_a_row': 2},
    }
    with new_line(tmp_path, values) as line, open_browser(tmp_path / 'browser') as browser:
        person = Person(browser, line)
        person.log_in('anna')

        def stop() -> str:
            return person.text('.stop')

        person.until(lambda: stop().startswith('STOP TooManyRejects: '))
        assert 'TooManyRejects reset' in person.does('Reset stop', '✓', 'Reset')
        person.until(lambda: not stop())
        browser.refresh()
        person.until(lambda: person.text('.decision') == '↑ OVER')
        assert not stop()


@needs_browser
def test_trained_parameters_count_when_a_person_has_seen_the_table(tmp_path: Path):
    passing = {'simulator.masses': [0.2], 'simulator.speed': 1.5}
    file, learned = tmp_path / 'machine.yaml', tmp_path / 'machine.new.yaml'
    file.write_text('# what the line has\n')
    with running_line(tmp_path, **passing) as line, open_browser(tmp_path) as browser:
        person = Person(browser, line)
        person.log_in('ben')

        def begun() -> bool:
            person.open('Dynamic setting')
            person.until(lambda: re.search('Recorded|✗', person.text('.dialog')))
            if runs := '✗' not in person.text('.dialog'):
                return runs
            assert 'dynamic_setting does not run' in person.text('.dialog .result')
            person.close()
            return False

        assert not begun()
        with dynamic_setting(tmp_path):
            person.until(begun)
            person.press('Train')
            assert 'no passes' in person.result('✗')
            person.fill('Mass', '200')
            person.fill('Passes', '1000')
            person.press('Record passes')
            person.until(lambda: re.match(r'recording, (8|9|\d\d+) of', person.text('.state')))
            person.press('End recording')
            person.until(lambda: 'of 1000 passes of 200 g recorded' in person.text('.state'))
            person.press('Train')
            person.until(lambda: person.text('.accuracy tbody').startswith('tvlpf'))
            assert learned.exists()
            assert file.read_text() == '# what the line has\n'
            person.press('Take over')
            person.until(lambda: 'version 2' in person.text('.dialog .result'))
            person.until(lambda: not person.text('.accuracy'))
        assert 'tvlpf' in file.read_text()
        assert (tmp_path / 'machine.v1.yaml').read_text() == '# what the line has\n'
        assert line.noted('ben')[-1] == 'take over the trained parameters: done'
        kinds = [each.kind for each in read_log(tmp_path / 'audit.log').entries]
        assert kinds.count('tuned') == 1
