# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The audit log of a running line on the page, whole, sealed and tampered with, in a browser."""

from pathlib import Path

from browsers import errors_of, needs_browser, open_browser, shortcomings
from persons import SCRIPT, Person, new_line, running_line
from running import run_command
from sealing import make_keys
import yaml

from checkweigher_production.audit_log import read_log
from checkweigher_production.audit_seal import add_seal, private_key, seals_path

FILTER = 'Filter: node, who, what, why'
VALUES = {'driver': {'simulator.masses': [0.2]}}


def rows_of(person: Person) -> list[list[str]]:
    """Return the entries that are shown."""
    return person.browser.execute_script(
        'return [...document.querySelectorAll(".audit tbody tr")]'
        '.map(row => [...row.children].map(cell => cell.textContent))'
    )


@needs_browser
def test_a_change_is_seen_in_the_log_and_so_is_a_byte_that_was_changed(tmp_path: Path):
    key, public = make_keys(tmp_path / 'keys')
    machine = tmp_path / 'machine'
    machine.mkdir()
    (machine / 'recipes.yaml').write_text(yaml.safe_dump({'products': {SCRIPT: {'nominal': 0.2}}}))
    log = machine / 'audit.log'
    with (
        new_line(tmp_path, VALUES, '--trust', str(public)) as line,
        open_browser(tmp_path / 'browser') as browser,
    ):
        anna = Person(browser, line)
        anna.log_in('anna')
        anna.until(lambda: 'FAULT' in anna.text('.decision'))  # there is no product yet
        anna.does('Product', '✓', 'Select', choice=SCRIPT, Reason='spring')
        anna.open('Audit log')
        anna.until(lambda: anna.text('.conclusion').startswith('✓ the chain is whole: '))
        assert anna.text('.seals').startswith(f'There are no seals in {seals_path(log)}')
        # The name of the product is a script, and shown as a text.
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
def test_a_line_without_a_log_says_which_option_makes_one(tmp_path: Path):
    with running_line(tmp_path, audit=False) as line, open_browser(tmp_path) as browser:
        person = Person(browser, line)
        person.log_in('vera')
        assert 'Audit log' not in person.buttons('.work')
        person.log_out()
        person.log_in('anna')
        person.open('Audit log')
        assert 'run the line with --folder' in person.result('✗')
