# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Catalogues of the languages of the page."""

import re

from babel.messages.extract import extract_from_dir
from babel.messages.pofile import read_po
import pytest
from running import ROOT

from checkweigher_core.health.findings import Level
from checkweigher_core.records.reasons import Reason, StopReason, hint_of
from checkweigher_production.alarms import FAULT, NODE, STOP
from checkweigher_validation.batch.signatures import MEANINGS
from checkweigher_web.access.users import ROLES
from checkweigher_web.languages.language import FOLDER, NAMES

PACKAGE = ROOT / 'src/checkweigher_web/checkweigher_web'
MARKERS = {'say': None, 'Text': None, 'plural': (1, 2)}
# Names and hints of other packages, which the page shows.
OTHERS = (
    *(hint_of(each) for each in (*Reason, '')),
    *(each.hint for each in StopReason),
    *(each.name for each in Level),
    *(FAULT, STOP, NODE),
    *MEANINGS,
    *ROLES,
)
Key = str | tuple[str, ...]  # a text, or its singular and plural


def texts() -> list[Key]:
    """Return the texts of the page in the order of its files."""
    found = extract_from_dir(PACKAGE, [('**.py', 'python')], keywords=MARKERS)
    own = [each[2] for each in sorted(found, key=lambda each: each[:2])]
    return list(dict.fromkeys([*own, *OTHERS]))


def placeholders(text: str) -> set[str]:
    return set(re.findall(r'{(\w+)}', text))


@pytest.mark.parametrize('name', NAMES[1:])
def test_a_catalogue_has_each_text_of_the_page_and_no_other(name: str):
    with (FOLDER / f'{name}.po').open('rb') as file:
        catalogue = read_po(file, abort_invalid=True)
    known = {message.id: message.string for message in catalogue if message.id}
    used = set(texts())
    assert used - known.keys() == set(), f'add these to {name}.po'
    assert known.keys() - used == set(), f'no longer used: remove these from {name}.po'
    for key, translated in known.items():
        forms = (translated,) if isinstance(key, str) else translated
        assert all(forms)
        for form in forms:
            one = placeholders(key if isinstance(key, str) else key[-1])
            assert placeholders(form) == one, key
