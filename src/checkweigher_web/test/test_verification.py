# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verification of a simulated line on the page, in a real browser."""

import json
from pathlib import Path

from browsers import (
    check_all_widths,
    errors_of,
    needs_browser,
    open_browser,
    shortcomings,
)
from made_procedure import GUIDED_LINE, SHORT_PLAN
from persons import Line, Technician, new_line
from running import run_command
from selenium.webdriver.common.by import By
from served_page import get, get_text

VALUES = {'driver': GUIDED_LINE, 'reject': {'deadlines': False}}
REASON = 'Reason'


class Inspector(Technician):
    """Somebody who verifies a machine."""

    def sees(self, *words: str, where: str = '.foot .request') -> None:
        self.until(lambda: all(word in self.text(where) for word in words))

    def makes(self, step: str) -> None:
        self.sees(f'{step}: Do this')
        self.make('Make it')


def take_plan(ben: Inspector, path: Path) -> None:
    """Upload a wrong plan, which is refused, and then a correct plan."""
    ben.until(lambda: ben.browser.find_elements(By.CSS_SELECTOR, '.verify input[type=file]'))
    upload = ben.browser.find_element(By.CSS_SELECTOR, '.verify input[type=file]')
    wrong = path.with_name('wrong.yaml')
    wrong.write_text(SHORT_PLAN.replace('class: XIII', 'class: none'))
    upload.send_keys(str(wrong))
    ben.sees("class: class 'none' is not one of", where='.verify .found')
    ben.make('Begin')
    ben.said('✗', 'the plan: line')
    path.write_text(SHORT_PLAN)
    upload.send_keys(str(path))
    ben.sees('Steps: 9', where='.verify .found')


@needs_browser
def test_a_machine_is_verified_by_the_page_alone(tmp_path: Path):
    with new_line(tmp_path, VALUES) as line, open_browser(tmp_path / 'browser') as browser:
        ben = Inspector(browser, line)
        ben.log_in('anna')
        assert 'Commissioning' not in ben.entries()
        browser.get(f'http://127.0.0.1:{line.port}/commissioning/')
        ben.until(lambda: browser.current_url.endswith('/login'))
        ben.log_in('ben')
        ben.until(lambda: 'FAULT' in ben.text('.decision'))  # no product is selected yet
        ben.commission('5 Verify')
        assert 'operator' not in ben.text('.verify .form')  # labels, not keys
        take_plan(ben, tmp_path / 'plan.yaml')
        check_all_widths(browser)
        ben.make('Begin')
        for step in (
            'warm-up, zero after 0 min', 'warm-up, passes after 0 min',
            'warm-up, zero after 0.02 min',
        ):  # fmt: skip
            ben.makes(step)
        ben.sees('warm-up, passes after 0.02 min: Do this')
        ben.make('Skip')
        ben.said('✗', 'say why')
        browser.refresh()
        ben.commission('5 Verify')  # the verification continues without the page
        ben.sees('Step 4 of 9, warm-up, passes after 0.02 min: Do this', 'Run the belt at 60')
        assert '2 passes: Run the belt at' in ben.text('.verify .steps')  # of the next steps
        ben.fill(REASON, 'no weights')
        ben.make('Skip')
        ben.makes('zero, reading 1')  # reading 2 follows without a question
        ben.makes('middle at 60 m/min')
        for answer in ('Make it again', 'Go on'):
            ben.makes('small at 60 m/min')
            ben.sees('small at 60 m/min: Failed', 'the mean error is beyond its limit')
            assert '2 of 2 passes: ' in ben.text('.verify .read')
            assert shortcomings(browser) == []
            ben.make(answer)
        ben.makes('zero after the loads')
        ben.sees(': failed')
        ben.until(lambda: 'failed' in ben.text('.verify .reports'))
        ben.until(lambda: 'Step small at 60 m/min has 2 attempts' in ben.text('.verify .read'))
        assert 'passed, reading ' in ben.text('.verify .steps')
        assert 'skipped: no weights' in ben.text('.verify .steps')
        (folder,) = (line.folder / 'verifications').iterdir()
        link = browser.find_element(By.CSS_SELECTOR, '.verify .reports a').get_attribute('href')
        check_report(line, folder, str(link), tmp_path)
        browser.get(str(link))
        ben.until(lambda: 'Verification of an automatic checkweigher' in ben.text('h1'))
        assert errors_of(browser) == []
        noted = line.noted('ben')
    assert noted[0] == 'begin verification: asked from 127.0.0.1'
    assert f'skip step warm_up_0.02 of verification {folder.name}: done' in noted


def check_report(line: Line, folder: Path, link: str, scratch: Path) -> None:
    """Compare the report with the steps on the page, and with a report from the bag."""
    report = json.loads((folder / 'report.json').read_text())
    made = [(step['name'], step['verdict']) for step in report['steps']]
    assert made[3:] == [
        ('warm_up_0.02', 'skipped'), ('zero_1', 'passed'), ('zero_2', 'passed'),
        ('passes_60_middle', 'passed'), ('passes_60_small', 'failed'),
        ('passes_60_small', 'failed'), ('zero_after', 'passed'),
    ]  # fmt: skip
    assert all(verdict == 'passed' for _, verdict in made[:3])
    assert report['steps'][3]['why'] == ['no weights']
    assert report['identity']['how'] == 'on a running line'
    assert report['identity']['audit_log'] == str(line.folder / 'audit.log')
    assert (folder / 'plan.yaml').read_text() == SHORT_PLAN

    again = scratch / 'again'
    assert run_command('verify', '--from', folder / 'bag', '--output', again).returncode == 1
    for name in ('report.html', 'report.json'):
        assert (again / name).read_bytes() == (folder / name).read_bytes()

    address = link.partition(str(line.port))[2]
    assert get_text(line.port, address) == (folder / 'report.html').read_text()
    assert 'sandbox' in str(get(line.port, address).headers['Content-Security-Policy'])
    for other in (
        address.replace(folder.name, '..%2F..%2Faudit'), address.replace(folder.name, '.'),
        address.replace('.html', '.mcap'), address.replace('lane=', 'lane=other'),
    ):  # fmt: skip
        assert get(line.port, other).status == 404
