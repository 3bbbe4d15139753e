# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Languages and units of the page: translated texts, and masses, numbers and times as text."""

from collections.abc import Mapping
from functools import cache
from gettext import GNUTranslations, NullTranslations
from io import BytesIO
import math
from pathlib import Path

from babel import Locale, negotiate_locale
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po
from babel.numbers import get_decimal_symbol

from checkweigher_core.records import GRAMS, local_time

# Names of the cookies in which the browser stores the language and the unit that a user has chosen.
LANGUAGE, UNIT = 'checkweigher-language', 'checkweigher-unit'
FOLDER = Path(__file__).parent  # folder with a catalogue NAME.po for each language except English
_SOURCE = 'en_US'
NAMES = (_SOURCE, *sorted(path.stem for path in FOLDER.glob('*.po')))
# Number of units in 1 kg, and number of additional decimals compared with a mass in g.
_UNITS = {'g': (GRAMS, 0), 'kg': (1.0, 3), 'lb': (1 / 0.45359237, 3), 'oz': (16 / 0.45359237, 2)}
UNITS = tuple(_UNITS)


class Mass(float):
    """Mass in kg as a value of a `Text`. An infinite value means no limit."""


class Number(str):
    """Decimal number with a point, as a value of a `Text`."""

    __slots__ = ()


class Text(str):
    """English text that `Language` can translate later, with values for its placeholders.

    The string itself is English, with masses in g, for the audit log. A value may be another
    `Text`, a `Mass`, a `Number`, an integer, or a name, which is not translated.
    """

    __slots__ = ('template', 'values')
    template: str
    values: Mapping[str, object]

    def __new__(cls, template: str, /, **values: object) -> 'Text':
        """Return the text for an English template and its values."""
        text = super().__new__(cls, ENGLISH.filled(template, values))
        text.template, text.values = template, values
        return text


class Language:
    """Language and unit of mass of a viewer.

    A call with an English text returns its translation. `name` is 'en_US' or the name of a
    catalogue, and `unit` is one of `UNITS`. `tag` is the language tag for HTML, and `point` is the
    decimal mark. `per_kg` is the number of units in 1 kg, and `more_digits` is the number of
    additional decimals compared with a mass in g.
    """

    def __init__(self, name: str = _SOURCE, unit: str = 'g') -> None:
        self.name, self.unit = name, unit
        self.tag = name.replace('_', '-')
        self.per_kg, self.more_digits = _UNITS[unit]
        self.point = get_decimal_symbol(name)
        self._texts = _translations(name)

    def __call__(self, text: str, /, **values: object) -> str:
        """Return the translation of an English text, with values for its placeholders.

        A text without a translation stays English.
        """
        if isinstance(text, Text):
            values = {**text.values, **values}
            text = text.template
        return self.filled(self._texts.gettext(text) if text else '', values)

    def plural(self, one: str, many: str, count: int, /, **values: object) -> str:
        """Return the translation of a text for `count` items, with values for its placeholders.

        `one` is the English text for a count of 1, and `many` is the English text for other counts.
        """
        return self.filled(self._texts.ngettext(one, many, count), {'count': count, **values})

    def filled(self, template: str, values: Mapping[str, object]) -> str:
        """Return a template with its placeholders replaced by the values in this language."""
        return (
            template.format(**{k: self._value(v) for k, v in values.items()})
            if values
            else template
        )

    def _value(self, value: object) -> object:
        if isinstance(value, Mass):
            return self.short(value)
        if isinstance(value, Number):
            return value.replace('.', self.point)
        return self(value) if isinstance(value, Text) else value

    def knows(self, text: str) -> bool:
        """Return whether a text, which may come from a node, can be shown in this language.

        Returns true for a text with a translation, for an empty text, for any `Text`, and, if this
        language is English, for any text.
        """
        translated = isinstance(text, Text) or self._texts.gettext(text) != text
        return not text or translated or self.name == _SOURCE

    def number(self, value: float, digits: int, unit: str = '', sign: str = '') -> str:
        """Return the text for a number and its unit, or a dash if it is not finite.

        If `sign` is '+', a number that is not negative has a plus sign.
        """
        if not math.isfinite(value):
            return '–'
        shown = round(value, digits) + 0.0  # Adding zero turns -0.0 into 0.0.
        return f'{shown:{sign}.{digits}f}'.replace('.', self.point) + unit

    def entry(self, value: float) -> str:
        """Return a number as the text of an input field, with up to 9 significant digits."""
        return f'{value:.9g}'.replace('.', self.point)

    def amount(self, mass: float, digits: int = 3, sign: str = '') -> str:
        """Return the text for a mass in kg, without unit.

        `digits` is the number of decimals in g. A text in another unit has `more_digits` more
        decimals.
        """
        return self.number(self.per_kg * mass, digits + self.more_digits, sign=sign)

    def mass(self, mass: float, digits: int = 3, sign: str = '') -> str:
        """Return the text for a mass in kg, with unit.

        `digits` is the number of decimals in g. A text in another unit has `more_digits` more
        decimals.
        """
        return self.number(self.per_kg * mass, digits + self.more_digits, f' {self.unit}', sign)

    def short(self, mass: float) -> str:
        """Return the text for a mass in kg, with unit and at most 6 significant digits.

        A mass that is infinite or NaN is given as the translation of 'none'.
        """
        if not math.isfinite(mass):
            return self('none')
        return f'{self.per_kg * mass + 0.0:g}'.replace('.', self.point) + f' {self.unit}'

    def clock(self, stamp: int | None) -> str:
        """Return the local time of a stamp in ns, or a dash if the stamp is None."""
        return '–' if stamp is None else f'{local_time(stamp):%H:%M:%S}'


@cache
def language(name: str = _SOURCE, unit: str = 'g') -> Language:
    """Return the language object for a name and a unit, which all viewers share.

    The keys of cached texts and figures contain the language object, so viewers with the same
    language and unit also share these texts and figures.
    """
    return Language(name, unit)


def language_of(headers: Mapping[str, str], cookies: Mapping[str, str]) -> Language:
    """Return the language and unit that a user has chosen, by default the browser's language and g.

    `headers` and `cookies` are the headers and cookies of the request of the browser.
    """
    name, unit = cookies.get(LANGUAGE, ''), cookies.get(UNIT, '')
    if name not in NAMES:
        name = _accepted(headers.get('accept-language', ''))
    return language(name, unit if unit in UNITS else UNITS[0])


def _accepted(header: str) -> str:
    """Return the first available language of an Accept-Language header, or English.

    The weights in the header and the regions of its languages are ignored.
    """
    tags = [each.partition(';')[0].strip() for each in header[:200].split(',')]
    by_family = {name.partition('_')[0]: name for name in NAMES}
    found = negotiate_locale([tag.partition('-')[0] for tag in tags], by_family)
    return by_family.get(found or '', _SOURCE)


def own_name(name: str) -> str:
    """Return the name of a language in the language itself."""
    return str(Locale.parse(name).get_language_name(name)).capitalize()


@cache
def _translations(name: str) -> NullTranslations:
    if name == _SOURCE:
        return NullTranslations()
    compiled = BytesIO()
    with (FOLDER / f'{name}.po').open('rb') as file:
        write_mo(compiled, read_po(file))
    compiled.seek(0)
    return GNUTranslations(compiled)


ENGLISH = language()
