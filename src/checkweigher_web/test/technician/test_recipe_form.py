# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recipe form, in which a technician reads and types g, mm and m/min."""

import asyncio
from pathlib import Path

from nicegui import Client, ui
import pytest
import yaml

from checkweigher_production.recipes import given_recipes
from checkweigher_web.access.users import Role
from checkweigher_web.languages.language import ENGLISH
from checkweigher_web.technician.recipes import RecipesDialog, changes, row
from checkweigher_web.work.services import ActionRefusedError, Outcome

KEYS = {
    'nominal': 0.15,
    'tare': 0.004,
    'lower_limit': 'TU1',
    'upper_limit': 0.165,
    'guard': {'risk': 0.02},
    'length': [0.08, 0.12],
    'speed': [0.5, 1.5],
    'reason': True,
    'parameters': {'identifier': {'estimator': 'hann'}},
}


class Desk:
    """Desk of a technician that performs each action and adds it to `noted`."""

    needs_reason = False
    say = ENGLISH

    def __init__(self) -> None:
        self.noted: list[str] = []

    async def perform(self, role: Role, what: str, action, reason: str) -> Outcome:
        assert role is Role.TECHNICIAN
        self.noted.append(f'{what}, as {reason}')
        try:
            return Outcome(True, await action())
        except ActionRefusedError as error:
            return Outcome(False, str(error))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / 'recipes.yaml'
    path.write_text(yaml.safe_dump({'products': {'crisps': KEYS, 'nuts': {'nominal': 0.2}}}))
    return path


def filled(path: Path, name: str, **texts: str) -> tuple[list[str], str]:
    """Save a recipe with some fields filled in, and return the audit text and the outcome."""
    desk = Desk()

    async def work() -> str:
        with Client(ui.page('/')):
            dialog = RecipesDialog(desk, path)
            dialog.show()
            dialog._choose(name)
            fields = {
                f'{entry.key}{"" if entry.place is None else entry.place}': shown
                for entry, shown in dialog._fields.items()
            }
            fields |= {'product': dialog._name, 'more': dialog._more, 'reason': dialog._reason}
            for key, text in texts.items():
                fields[key.replace('guard', 'guard.risk')].set_value(text)
            await dialog._save()
            return str(dialog._result.text)

    return desk.noted, asyncio.run(work())


def test_a_recipe_that_is_saved_as_it_was_shown_is_the_same(path: Path):
    noted, said = filled(path, 'crisps', reason='spring')
    assert (noted, said) == (['recipe crisps: no change, as spring'], '✓ recipe crisps is saved')
    assert given_recipes(path)['crisps'] == KEYS


def test_numbers_of_the_form_are_those_of_the_recipe_in_other_units(path: Path):
    texts = {'nominal': '180,5', 'lower_limit': 'tu2', 'guard': '', 'speed1': '60', 'speed0': '45'}
    noted, _ = filled(path, 'nuts', **texts)
    wanted = {'nominal': 0.1805, 'lower_limit': 'TU2', 'speed': [0.75, 1.0]}
    assert given_recipes(path)['nuts'] == wanted
    changed = 'nominal 0.2 → 0.1805, lower_limit – → TU2, speed – → [0.75, 1.0]'
    assert noted == [f'recipe nuts: {changed}, as ']


@pytest.mark.parametrize(
    ('texts', 'complaint'),
    [
        ({'upper_limit': '140'}, 'crisps.upper_limit: 140 g is below nominal, 150 g'),
        ({'nominal': ''}, 'crisps.nominal: is missing; add it'),
        ({'more': 'colour: red'}, 'crisps.colour: no such key'),
    ],
)
def test_a_recipe_that_the_line_would_refuse_is_not_saved(
    path: Path, texts: dict[str, str], complaint: str
):
    before = path.read_bytes()
    _, said = filled(path, 'crisps', **texts)
    assert said.startswith(f'✗ not done: {complaint}')
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ('texts', 'complaint'),
    [
        ({'length1': ''}, 'length: give both ends of the range, or none'),
        ({'more': 'nominal: 2'}, 'Further keys: line 1: write'),
        ({'more': '- a'}, 'Further keys: line 1: write'),
        ({'product': ' '}, 'Product: give a name'),
    ],
)
def test_a_form_that_is_not_complete_is_told(path: Path, texts: dict[str, str], complaint: str):
    with pytest.raises(ActionRefusedError, match=f'^{complaint}'):
        filled(path, 'crisps', **texts)


def test_the_table_has_units():
    assert row('crisps', KEYS)[3:] == [
        '150 g', 'TU1 … 165 g', '2 %', '80 … 120 mm', '30 … 90 m/min'
    ]  # fmt: skip
    assert row('nuts', {'nominal': 0.2})[3:] == ['200 g', '–', '–', '–', '–']
    assert changes(None, {'nominal': 0.2}) == 'nominal – → 0.2'
