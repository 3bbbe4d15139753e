# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batch rules, batch report and signatures on the page, in a real browser."""

from pathlib import Path

from browsers import errors_of, needs_browser, open_browser
from persons import PASSWORD, Person, new_line
from selenium.webdriver.common.by import By
from served_page import get, get_text

from checkweigher_production.audit_log import read_log
from checkweigher_validation.batch.signatures import signatures_in

RECIPE = {
    'nominal': 0.15, 'lower_limit': 'TU2', 'tu1_quota': 0.025, 'mean_value': True,
    'filler': {'max_correction': 0.004, 'subgroup': 2},
}  # fmt: skip
BATCH = '.L 1/2'  # not a valid file name, and with the dot of a hidden file
VALUES = {'driver': {'simulator.masses': [0.152]}}


@needs_browser
def test_a_batch_has_its_rules_on_the_page_and_its_report_when_it_has_ended(tmp_path: Path):
    with (
        new_line(tmp_path, VALUES, products={'crisps': RECIPE}) as line,
        open_browser(tmp_path / 'browser') as browser,
    ):
        anna = Person(browser, line)
        anna.log_in('anna')
        anna.until(lambda: 'FAULT' in anna.text('.decision'))  # no product is selected yet
        anna.does('Product', '✓', 'Select', choice='crisps')
        anna.until(lambda: '% of at most 2.5 %' in anna.text('.production'))
        anna.until(lambda: 'g of 150.000 g; an item may lack' in anna.text('.production'))
        # The products are 2 g too heavy, so each correction is negative.
        anna.until(lambda: 'filler correction, g -' in ' '.join(anna.text('.production').split()))
        for batch in (BATCH, 'L2'):
            anna.does('New batch', '✓', 'Begin', Batch=batch)
        report = line.folder / 'batches' / '.L 1%2F2.html'
        anna.until(report.exists)

        def listed() -> bool:
            anna.open('Batch reports')
            found = f'{BATCH}:' in anna.text('.dialog .reports')
            if not found:
                anna.close()
            return found

        anna.until(listed)
        links = browser.find_elements(By.CSS_SELECTOR, '.dialog .reports a')
        of_batch = [str(each.get_attribute('href')) for each in links]
        (link,) = (each for each in of_batch if '.L%201%252F2.html' in each)
        address = link.partition(str(line.port))[2]
        assert get_text(line.port, address) == report.read_text()
        assert get(line.port, address.replace('.html', '.json')).status == 200
        assert get(line.port, address.replace('.L%201%252F2', 'none')).status == 404
        log = line.folder / 'audit.log'
        anna.until(lambda: any(each.kind == 'report' for each in read_log(log).entries))
        anna.close()

        def sign(what: str, meaning: str, password: str, result: str) -> str:
            anna.open('Sign')
            anna.choose(what)
            anna.press(meaning)
            anna.fill('Password', password)
            anna.press('Sign')
            said = anna.result(result)
            anna.close()
            return said

        what = f'batch {BATCH}'
        assert 'anna: the password is wrong' in sign(what, 'review', 'wrong', '✗')
        assert 'a release needs a technician' in sign(what, 'release', PASSWORD, '✗')
        assert 'batch L2 has not ended yet' in sign('batch L2', 'review', PASSWORD, '✗')
        assert f'review of {what} signed by anna' in sign(what, 'review', PASSWORD, '✓')
        # A signature does not end the session, and the choice names the signers.
        sign(f'{what} (review by anna)', 'approval', PASSWORD, '✓')
        entries = read_log(log).entries
        signed = signatures_in(entries, BATCH)
        assert [(each.meaning, each.is_genuine) for each in signed] == [
            ('review', True),
            ('approval', True),
        ]
        assert {each.who for each in entries if each.kind == 'signature'} == {'anna'}
        assert f'review of {what}: refused: anna: the password is wrong; nothing was signed' in (
            line.noted('anna')
        )
        assert errors_of(browser) == []
