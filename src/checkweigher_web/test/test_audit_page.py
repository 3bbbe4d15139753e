# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Audit log of a running line on the page, intact and modified, in a real browser."""

from pathlib import Path

from browsers import errors_of, needs_browser, open_browser, shortcomings
from persons import SCRIPT, Line, Person, Technician, add_users, new_line
from running import run_command
from sealing import make_keys
from served_page import line_of, served

from checkweigher_production.audit_log import read_log
from checkweigher_production.audit_seal import add_seal, private_key, seals_path

FILTER = 'Filter: node, who, what, why'
VALUES = {'driver': {'simulator.masses': [0.2]}}


def rows_of(person: Person) -> list[list[str]]:
    return person.browser.execute_script(
        'return [...document.querySelectorAll(".audit tbody tr")]'
        '.map(row => [...row.children].map(cell => cell.textContent))'
    )


@needs_browser
def test_a_change_is_seen_in_the_log_and_so_is_a_byte_that_was_changed(tmp_path: Path):
    key, public = make_keys(tmp_path / 'keys')
    trust, products = ('--trust', str(public)), {SCRIPT: {'nominal': 0.2}}
    with (
        new_line(tmp_path, VALUES, *trust, products=products) as line,
        open_browser(tmp_path / 'browser') as browser,
    ):
        log = line.folder / 'audit.log'
        anna = Person(browser, line)
        anna.log_in('anna')
        anna.until(lambda: 'FAULT' in anna.text('.decision'))  # no product is selected yet
        anna.does('Product', '✓', 'Select', choice=SCRIPT, Reason='spring')
        anna.open('Audit log')
        anna.until(lambda: anna.text('.conclusion').startswith('✓ the chain is whole: '))
        assert anna.text('.seals').startswith(f'There are no seals in {seals_path(log)}')
        # The product name is a script, which the page shows as text.
        selected = [row for row in rows_of(anna) if row[3] == 'selection']
        assert [(row[2], row[5]) for row in selected] == [('anna', 'spring')]
        assert SCRIPT in selected[0][4]
        numbers = [int(row[0]) for row in rows_of(anna)]
        assert numbers == sorted(numbers, reverse=True)
        assert shortcomings(browser) == []
        assert all(anna.fits(width) for width in (375, 800, 1600))

        anna.fill(FILTER, 'SELECTION')
        anna.until(lambda: [row[3] for row in rows_of(anna)] == ['selection'])
        assert "1 of them with 'SELECTION'" in anna.text('.count')
        anna.fill(FILTER, '')
        anna.until(lambda: len(rows_of(anna)) > 1)

        seal = add_seal(seals_path(log), log, read_log(log).entries, private_key(key))
        anna.press('Read again')
        anna.until(lambda: f'through entry {seal.entries}; ' in anna.text('.seals'))
        assert 'level-OK' in anna.attribute('.seals', 'class')

        log.write_bytes(log.read_bytes().replace(b'"why":"spring"', b'"why":"sprint"', 1))
        anna.press('Read again')
        anna.until(lambda: anna.text('.conclusion').startswith('✗ BROKEN: line '))
        said = run_command('audit', log).stdout.splitlines()[-1]
        assert anna.text('.conclusion') == f'✗ {said}'
        assert ': changed: it is no entry' in said
        assert 'level-ERROR' in anna.attribute('.conclusion', 'class')
        assert not any(row[5] == 'sprint' for row in rows_of(anna))
        assert shortcomings(browser) == []
        assert errors_of(browser) == []


@needs_browser
def test_a_line_without_a_folder_says_what_it_lacks(tmp_path: Path):
    users = tmp_path / 'users'
    add_users(users)
    with (
        line_of(tmp_path / 'line.yaml', {'driver': {'simulator.count': 0}}),
        served('--users', str(users)) as (_, port),
        open_browser(tmp_path / 'browser') as browser,
    ):
        person = Technician(browser, Line(port, tmp_path))
        person.log_in('vera')
        assert not person.buttons('.work')
        person.log_out()
        person.log_in('anna')
        person.open('Audit log')
        assert 'run the line with --folder' in person.result('✗')
        person.close()
        person.log_out()
        person.log_in('ben')
        person.commission('3 Dynamic')
        person.until(lambda: 'without a folder' in person.standing('3 Dynamic'))
