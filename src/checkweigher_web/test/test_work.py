# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A person works on a running line by the page alone, in a real browser."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
import re
import subprocess
import sys

from browsers import needs_browser, open_browser
from running import PATIENCE
from selenium.common.exceptions import TimeoutException, WebDriverException
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.wait import WebDriverWait
from served_page import served
import yaml

from checkweigher_dsp.production.audit_log import read_log
from checkweigher_web.access.users import Role, User, hash_password, write_users

PASSWORD = 'correct horse'
SCRIPT = '<img src=x onerror=alert(1)>'
EMPTY = 600.0  # s, of the simulated belt before the first product


@dataclass
class Line:
    """A line on a simulated scale, with its page."""

    port: int
    folder: Path

    def noted(self, name: str) -> list[str]:
        """Return what the audit log has of a person."""
        entries = read_log(self.folder / 'audit.log').entries
        return [str(each.new) for each in entries if (each.kind, each.subject) == ('person', name)]


@contextmanager
def running_line(folder: Path, **driver: object) -> Iterator[Line]:
    """Run a line with a simulated driver, and its page."""
    known = hash_password('x', PASSWORD)
    roles = {'anna': Role.OPERATOR, 'ben': Role.TECHNICIAN, 'vera': Role.VIEWER}
    write_users(folder / 'users', {n: User(n, role, known) for n, role in roles.items()})
    recipes = {'crisps': {'nominal': 0.15}, SCRIPT: {'nominal': 0.2, 'reason': True}}
    (folder / 'recipes.yaml').write_text(yaml.safe_dump({'products': recipes}))
    values = {
        'driver': {
            'source': 'simulator', 'simulator.count': 0,
            'calibration.file': str(folder / 'cell.yaml'), 'calibration.duration': 0.5, **driver,
        },
        'product': {
            'recipes': str(folder / 'recipes.yaml'), 'audit_log': str(folder / 'audit.log')
        },
    }  # fmt: skip
    sections = {f'/**/{node}': {'ros__parameters': each} for node, each in values.items()}
    (folder / 'line.yaml').write_text(yaml.safe_dump(sections))
    words = ['-m', 'checkweigher_bringup.cli', 'run', '--params', str(folder / 'line.yaml')]
    running = subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL)
    try:
        with served('--users', str(folder / 'users')) as (_, port):
            yield Line(port, folder)
    finally:
        running.terminate()
        running.wait()


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


class Person:
    """Somebody at the browser."""

    def __init__(self, browser: Chrome, line: Line) -> None:
        self.browser, self.line = browser, line

    def until(self, condition: Callable[[], object]) -> object:
        wait = WebDriverWait(self.browser, PATIENCE, poll_frequency=0.1)
        try:
            return wait.until(lambda _: condition())
        except TimeoutException:
            raise AssertionError(f'{self.browser.current_url}: {self.text("body")}') from None

    def log_in(self, name: str) -> None:
        self.browser.set_window_size(800, 900)
        self.browser.get(f'http://127.0.0.1:{self.line.port}/login')
        self.browser.find_element(By.NAME, 'name').send_keys(name)
        self.browser.find_element(By.NAME, 'password').send_keys(PASSWORD + Keys.ENTER)
        self.until(lambda: name in self.text('.head'))

    def text(self, selector: str) -> str:
        script = 'return document.querySelector(arguments[0])?.innerText ?? ""'
        return str(self.browser.execute_script(script, selector))

    def buttons(self, where: str) -> dict[str, object]:
        found = self.browser.find_elements(By.CSS_SELECTOR, f'{where} button')
        return {each.text.strip(): each for each in found}

    def press(self, name: str, where: str = '.dialog') -> None:
        self.until(lambda: self.clicked(f'{where} button', name))

    def open(self, name: str) -> None:
        self.press(name, '.work')
        self.until(lambda: self.text('.dialog h2') == name)

    def fill(self, label: str, text: str) -> None:
        path = f'.dialog input[aria-label="{label}"]'
        self.until(lambda: self.browser.find_elements(By.CSS_SELECTOR, path))
        field = self.browser.find_element(By.CSS_SELECTOR, path)
        field.send_keys(Keys.CONTROL, 'a')
        field.send_keys(text)

    def choose(self, name: str) -> None:
        self.until(lambda: self.clicked('.dialog .q-select'))
        self.until(lambda: self.clicked('.q-menu .q-item', name))

    def clicked(self, selector: str, text: str = '') -> bool:
        # While a dialog before it fades out, it is in the way.
        found = self.browser.find_elements(By.CSS_SELECTOR, selector)
        for each in found:
            if text in ('', each.text.strip()):
                with suppress(WebDriverException):
                    each.click()
                    return True
        return False

    def result(self, sign: str) -> str:
        self.until(lambda: self.text('.dialog .result').startswith(sign))
        return self.text('.dialog .result')

    def does(self, name: str, sign: str, verb: str = '') -> str:
        self.open(name)
        self.press(verb or name)
        result = self.result(sign)
        self.close()
        return result

    def close(self) -> None:
        self.press('Close')
        self.until(lambda: not self.text('.dialog'))

    def log_out(self) -> None:
        self.press('Log out', '.head')
        self.until(lambda: self.browser.current_url.endswith('/login'))


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
        person.does('Zero', '✓')
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

        person.open('Calibration')
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
        person.close()
        person.open('Calibration')
        person.fill('Reason', 'new load cell')
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
