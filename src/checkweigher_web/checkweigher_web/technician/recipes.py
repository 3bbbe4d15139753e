# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog in which a technician changes, adds, removes, imports and exports recipes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import json, ui

from checkweigher_core.parameters import SettingsError, flatten
from checkweigher_core.settings_files import read_settings
from checkweigher_core.yaml_files import opened, yaml_text
from checkweigher_production.recipes import (
    RecipeFile,
    change_recipe,
    given_recipes,
    replace_recipes,
)
from checkweigher_web.access.users import Role
from checkweigher_web.elements import ItemList, scrolled, text_file_input
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.work import actions
from checkweigher_web.work.dialogs import Desk, Dialog, ask, field, number_in, reason_field
from checkweigher_web.work.services import ActionRefusedError, LaneServices, Outcome

Keys = dict[str, Any]  # keys and values of a recipe in the recipe file

_HEADS = (
    Text('product'),
    Text('nominal'),
    Text('limits'),
    Text('guard'),
    Text('length'),
    Text('speed'),
)
_TEXT = Text(
    'Choose a recipe to change it, or fill in the fields for a new one. A change holds from the '
    'next selection of the product. Comments in the file are lost with the first change.'
)
_REMOVE = Text('The recipe leaves the file. A product that is on the line stays there.')
_IMPORT = Text('All recipes are replaced by those of the chosen file: {names}.')
_LARGEST = 256 * 1024  # maximum number of bytes that a browser sends from a recipe file to import
_MM, _PERCENT, _PER_MINUTE = 1000.0, 100.0, 60.0


@dataclass(frozen=True)
class _Entry:
    """Field of the form: its key in a recipe, label, unit, and place in a list.

    A number in the form is `factor` times the number in the recipe. For a mass, which is in the
    unit of the user, `unit` is '' and `factor` is 0. If the value of the key is a list, `place` is
    the index of the number in the list.
    """

    key: str
    label: Text
    unit: str = ''
    factor: float = 0.0
    place: int | None = None
    words: tuple[str, ...] = ()  # words that the field accepts instead of a number

    def text(self, keys: Mapping[str, Any], say: Language) -> str:
        """Return the text of the field for a recipe, or '' if the recipe lacks the key."""
        value = _inner(keys, self.key)
        if self.place is not None and isinstance(value, list):
            value = value[self.place]
        return value if isinstance(value, str) else '' if value is None else self.number(value, say)

    def number(self, value: float, say: Language) -> str:
        """Return the text of the field for a number in the recipe."""
        return say.entry(round((self.factor or say.per_kg) * value, 9))

    def value(self, given: ui.input, say: Language) -> float | str | None:
        """Return the value of the field for the recipe, or None for an empty field.

        Raises `ActionRefusedError` if the text is not a number, or is ambiguous in the language of
        the user.
        """
        text = str(given.value or '').strip()
        if text.upper() in self.words:
            return text.upper()
        return round(number_in(given, say) / (self.factor or say.per_kg), 9) if text else None


_ENTRIES = (
    _Entry('nominal', Text('Nominal mass of the contents')),
    _Entry('tare', Text('Mass of the packaging')),
    _Entry('lower_limit', Text('Lower limit, or TU1 or TU2'), words=('TU1', 'TU2')),
    _Entry('upper_limit', Text('Upper limit')),
    _Entry('guard.risk', Text('Guard band: risk'), '%', _PERCENT),
    _Entry('length', Text('Shortest length'), 'mm', _MM, 0),
    _Entry('length', Text('Longest length'), 'mm', _MM, 1),
    _Entry('speed', Text('Slowest belt'), 'm/min', _PER_MINUTE, 0),
    _Entry('speed', Text('Fastest belt'), 'm/min', _PER_MINUTE, 1),
)
_OWN = {entry.key.partition('.')[0] for entry in _ENTRIES}


async def recipes(desk: Desk, services: LaneServices) -> None:
    """Open a dialog with the recipes of a lane.

    Raises `ActionRefusedError` if the lane has no recipe file.
    """
    RecipesDialog(desk, await actions.recipe_file(services)).show()


class RecipesDialog(Dialog):
    """Dialog with a list of recipes, and a form for the chosen recipe."""

    def __init__(self, desk: Desk, path: Path) -> None:
        super().__init__(Text('Recipes'), desk.say, wide=True)
        say = desk.say
        self._desk, self._path = desk, path
        self._recipes: dict[str, Keys] = {}
        self._imported = ''
        with self.body:
            ui.label(say(_TEXT))
            with scrolled('choices', say('recipes')):
                self._list = ItemList(map(say, _HEADS), self._choose, say('change recipe'))
            with ui.element('div').classes('form'):
                self._name = field(say('Product'))
                self._fields = {
                    each: field(say(each.label), unit=each.unit or say.unit).props('stack-label')
                    for each in _ENTRIES
                }
            self._more = ui.textarea(say('Further keys, as in the file')).classes('plan')
            self._more.props('outlined dense')
            with ui.element('label').classes('in-a-row'):
                ui.label(say('Recipes from a file'))
                text_file_input(say('Recipes from a file'), _LARGEST, self._take_file)
            self._reason = reason_field(desk)
        self.button(Text('Import'), self._import)
        self.button(Text('Export'), self._export)
        self.button(Text('Remove'), self._remove)
        self.button(Text('Save'), self._save)

    def show(self) -> None:
        """Read the recipe file, and show its recipes, or the reason why it cannot be read."""
        try:
            self._recipes = given_recipes(self._path)
        except SettingsError as error:
            self.tell(Outcome(False, str(error)))
        self._list.show_text(json.dumps([row(*each, self.say) for each in self._recipes.items()]))

    def _choose(self, name: str) -> None:
        keys = self._recipes.get(name, {})
        self._list.choose(name)
        self._name.set_value(name)
        for entry, shown in self._fields.items():
            shown.set_value(entry.text(keys, self.say))
        more = {key: value for key, value in keys.items() if key not in _OWN}
        self._more.set_value(yaml_text(more) if more else '')

    async def _save(self) -> None:
        name, keys = str(self._name.value or '').strip(), self._keys()
        if not name:
            raise ActionRefusedError(Text('Product: give a name'))
        changed = changes(self._recipes.get(name), keys)
        what = Text('recipe {name}: {changes}', name=name, changes=changed)
        change = partial(change_recipe, self._path, name, keys)
        said = Text('recipe {name} is saved', name=name)
        save = partial(actions.change_file, change, said)
        outcome = await self._desk.perform(
            Role.TECHNICIAN, what, save, str(self._reason.value or '')
        )
        self.tell(outcome)
        self.show()
        self._list.choose(name)

    def _keys(self) -> Keys:
        """Return the recipe in the form, or raise `ActionRefusedError` if a field is not valid."""
        keys: Keys = {}
        for entry, given in self._fields.items():
            _put(keys, entry, entry.value(given, self.say))
        for key in ('length', 'speed'):
            if None in keys.get(key, ()):
                text = Text('{range}: give both ends of the range, or none', range=Text(key))
                raise ActionRefusedError(text)
        try:
            with opened(str(self._more.value or '{}')) as more:
                if not isinstance(more, dict) or _OWN & more.keys():
                    raise SettingsError('write lines "key: value", only for keys without a field')
                return keys | more
        except SettingsError as error:
            raise ActionRefusedError(Text('Further keys: {error}', error=str(error))) from None

    async def _remove(self) -> None:
        name = str(self._name.value or '').strip()
        if name not in self._recipes:
            raise ActionRefusedError(Text('choose a recipe first'))
        remove = partial(change_recipe, self._path, name, None)
        what = Text('recipe {name}: removed', name=name)
        self._confirm(Text('Remove recipe'), Text('Remove'), _REMOVE, what, remove)

    def _confirm(
        self, title: Text, verb: Text, text: Text, what: Text, change: partial[None]
    ) -> None:
        async def act() -> str:
            said = await actions.change_file(change, what)
            self.show()
            return said

        ask(self._desk, title, text, verb, lambda: (what, act), role=Role.TECHNICIAN)

    def _take_file(self, text: str) -> None:
        self._imported = text

    async def _import(self) -> None:
        if not self._imported:
            raise ActionRefusedError(Text('choose a file first'))
        if len(self._imported.encode()) >= _LARGEST:
            raise ActionRefusedError(Text('the file is too large for recipes'))
        try:
            found = read_settings(self._imported, RecipeFile).products
        except SettingsError as error:
            raise ActionRefusedError(str(error)) from None
        names = ', '.join(found)
        change = partial(replace_recipes, self._path, self._imported)
        text = Text(_IMPORT.template, names=names)
        what = Text('recipes imported: {names}', names=names)
        self._confirm(Text('Import recipes'), Text('Import'), text, what, change)

    async def _export(self) -> None:
        try:
            ui.download(self._path.read_bytes(), self._path.name)
        except OSError as error:
            raise ActionRefusedError(f'{self._path}: {error.strerror}') from None


def _inner(keys: Mapping[str, Any], key: str) -> Any:
    """Return the value of a key such as ``guard.risk``, or None if the key is missing.

    If the value of the outer key, here ``guard``, is not a mapping, this value is returned.
    """
    outer, _, inner = key.partition('.')
    value = keys.get(outer)
    return value.get(inner) if inner and isinstance(value, dict) else value


def _put(keys: Keys, entry: _Entry, value: float | str | None) -> None:
    outer, _, inner = entry.key.partition('.')
    if entry.place is not None:
        keys.setdefault(outer, []).append(value)
        if entry.place and keys[outer] == [None, None]:
            del keys[outer]
    elif value is not None:
        keys[outer] = {inner: value} if inner else value


def row(name: str, keys: Keys, say: Language = ENGLISH) -> list[str]:
    """Return the row of a recipe for `ItemList`: key, name, empty decision, and further cells."""
    text = {entry: entry.text(keys, say) for entry in _ENTRIES}
    nominal, _, lower, upper, guard, *ranges = _ENTRIES
    limits = f'{text[lower] or "–"} … {text[upper] or "–"}' if text[lower] or text[upper] else ''
    spans = [f'{text[a]} … {text[b]} {a.unit}' if text[a] else '–' for a, b in _pairs(ranges)]
    return [
        name,
        name,
        '',
        f'{text[nominal]} {say.unit}',
        f'{limits} {say.unit}' if limits else '–',
        f'{text[guard]} %' if text[guard] else '–',
        *spans,
    ]


def _pairs(ranges: list[_Entry]) -> list[tuple[_Entry, _Entry]]:
    return list(zip(ranges[::2], ranges[1::2], strict=True))


def changes(old: Keys | None, new: Keys) -> str:
    """Return the changes of a recipe as one line for the audit log, or 'no change'.

    `old` is None for a new recipe.
    """
    before, after = flatten(old or {}), flatten(new)
    changed = (
        f'{key} {before.get(key, "–")} → {after.get(key, "–")}'
        for key in {**before, **after}
        if before.get(key) != after.get(key)
    )
    return ', '.join(changed) or 'no change'
