# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Printed reports, in which no table is wider than a sheet of A4, which is narrower than Letter."""

from browsers import needs_browser, open_browser
from made_evaluations import make_evaluation
from made_procedure import attempt_of, procedure_of

from checkweigher_production.audit_log import Entry
from checkweigher_validation.batch.batch import Batch
from checkweigher_validation.report.batch_page import render_batch
from checkweigher_validation.report.page import render
from checkweigher_validation.report.verification_page import render_verification
from checkweigher_validation.verification.report import report_of

_SHEET = 186 / 25.4 * 96  # width of A4 within its margins in px
_TOO_WIDE = """
return [...document.querySelectorAll('table, dl, p')]
  .filter(each => each.getBoundingClientRect().right > innerWidth + 1).map(each => each.innerText);
"""


def batch() -> str:
    value = {f'identifier.learned.reflection_{n}': 1250005.6 / n for n in range(1, 40)}
    time = '2026-01-01T10:00:30.123456+00:00'
    words = ('graph:/lane1/driver', 'parameter', f'/lane1/identifier.{60 * "x"}')
    changes = (Entry(12345, time, *words, value, value, '', 'anna.technician', 'other crisps'),)
    stop = {'time': time, 'reason': 'TooManyRejects', 'item_id': 1, 'text': 30 * 'rejected '}
    made = Batch('L1', 'L1.jsonl', (), 64 * '0', begin=time, stops=(stop,), changes=changes)
    return render_batch(made, [])


def verification() -> str:
    skipped = attempt_of('static_up_small', skipped='the weights are at the laboratory')
    passes = attempt_of('passes_60_small', masses=[74.7] * 3, faults=1)
    return render_verification(report_of(procedure_of(passes, skipped)))


@needs_browser
def test_nothing_is_wider_than_a_sheet(tmp_path):
    reports = {'batch': batch(), 'verification': verification(), 'all': render(make_evaluation())}
    with open_browser(tmp_path / 'browser') as driver:
        driver.execute_cdp_cmd('Emulation.setEmulatedMedia', {'media': 'print'})
        size = {'width': int(_SHEET), 'height': 1000, 'deviceScaleFactor': 1, 'mobile': False}
        driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', size)
        for name, page in reports.items():
            path = tmp_path / f'{name}.html'
            path.write_text(page)
            driver.get(path.as_uri())
            assert driver.execute_script(_TOO_WIDE) == []
