# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts, masses and numbers in the language and unit of a viewer."""

import math

from nicegui import Client, ui
import pytest

from checkweigher_core.records import Decision, Verdict
from checkweigher_web.lane import ShownItem
from checkweigher_web.languages.language import ENGLISH, Mass, Text, language, language_of
from checkweigher_web.languages.wording import from_node
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.views.item import reading
from checkweigher_web.views.masses import histogram
from checkweigher_web.work.dialogs import field, mass_in
from checkweigher_web.work.services import ActionRefusedError


@pytest.mark.parametrize(
    ('name', 'unit', 'shown'),
    [
        ('en_US', 'g', '1234.500 g'),
        ('de', 'g', '1234,500 g'),
        ('zh_CN', 'g', '1234.500 g'),
        ('de', 'kg', '1,234500 kg'),
        ('en_US', 'lb', '2.721607 lb'),  # 1 lb is 0.45359237 kg
        ('de', 'oz', '43,54571 oz'),
    ],
)
def test_a_mass_is_in_the_unit_and_with_the_decimal_mark_of_the_viewer(
    name: str, unit: str, shown: str
):
    assert language(name, unit).mass(1.2345) == shown
    assert language(name, unit).mass(math.nan) == '–'
    assert not language(name, unit).mass(-1e-9).startswith('-')


def test_a_text_is_english_in_the_log_and_translated_on_the_page():
    text = Text(
        'set limits to {limits}',
        limits=Text('{lower} and {upper}', lower=Mass(0.1), upper=Mass(math.inf)),
    )
    assert text == 'set limits to 100 g and none'
    assert language('de', 'kg')(text) == 'Grenzen auf 0,1 kg und keine setzen'
    assert language('zh_CN')(text) == '将限值设为 100 g 和 无'


def test_a_number_of_things_has_its_plural_form():
    alarms = '{count} alarm', '{count} alarms'
    assert [language('de').plural(*alarms, count) for count in (0, 1)] == ['0 Alarme', '1 Alarm']
    assert language('zh_CN').plural(*alarms, 1) == '1 个报警'


def test_a_message_of_a_node_is_translated_if_its_pattern_is_known():
    german = language('de')
    known = from_node('zeroed at 0.000100 kg from the zero of calibration')
    assert german(known) == 'nullgestellt, 0,1 g von der Null der Justierung entfernt'
    assert german.knows(known)
    assert german.knows('close {it}') is False
    assert german(from_node('close {it}')) == 'close {it}'


@pytest.mark.parametrize(
    ('header', 'cookies', 'name', 'unit'),
    [
        ('', {}, 'en_US', 'g'),
        ('de-AT,de;q=0.9,en;q=0.8', {}, 'de', 'g'),
        ('fr, zh-CN;q=0.8', {}, 'zh_CN', 'g'),
        ('fr', {}, 'en_US', 'g'),
        ('de', {'checkweigher-language': 'zh_CN', 'checkweigher-unit': 'lb'}, 'zh_CN', 'lb'),
        ('de', {'checkweigher-language': '../de', 'checkweigher-unit': 'stone'}, 'de', 'g'),
    ],
)
def test_the_choice_of_a_user_comes_before_that_of_the_browser(
    header: str, cookies: dict[str, str], name: str, unit: str
):
    found = language_of({'accept-language': header}, cookies)
    assert (found.name, found.unit) == (name, unit)
    assert found is language(name, unit)


@pytest.mark.parametrize(
    ('name', 'unit', 'text', 'mass'),
    [
        ('en_US', 'g', '150,5', 0.1505),
        ('de', 'g', '1,000', 0.001),
        ('de', 'kg', '0,15', 0.15),
        ('en_US', 'lb', '0.220462262', 0.1),
        ('de', 'g', '1.000', None),
        ('en_US', 'g', '1,000', None),
    ],
)
def test_a_mass_is_read_in_the_unit_and_notation_of_the_user(
    name: str, unit: str, text: str, mass: float | None
):
    say = language(name, unit)
    with Client(ui.page('/')):
        given = field('Mass', text, unit)
    if mass is None:
        with pytest.raises(ActionRefusedError, match='write one of these'):
            mass_in(given, say)
    else:
        assert mass_in(given, say) == mass


def test_the_views_of_two_viewers_differ_in_language_and_unit_alone():
    verdict = Verdict(
        7, 2, Decision.FAULT, ('NoLoad',), t1=1, mass=0.15, lower_limit=0.1, upper_limit=0.2
    )
    item, say = ShownItem(verdict), language('de', 'kg')
    english, german = (reading(item, [item], None, each) for each in (ENGLISH, say))
    assert (german['decision'], german['word'], german['mass']) == ('FAULT', 'FEHLER', '0,15000 kg')
    assert german['why'].startswith('NoLoad: die Wägezelle')
    assert [name for name, *_ in german['scale']['limits']] == ['untere 0,1', 'obere 0,2']
    assert german['scale']['at'] == english['scale']['at'] == 0.5
    series = MassSeries(masses=(0.148, 0.152))
    (one,), (other,) = (histogram(series, verdict, None, s)['series'] for s in (ENGLISH, say))
    assert [x for x, _ in other['data']] == pytest.approx([x / 1000 for x, _ in one['data']])
    assert [y for _, y in other['data']] == [y for _, y in one['data']]
