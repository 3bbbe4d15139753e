# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recipes: limits worked by hand, and every bad recipe refused with the key that is wrong."""

import json
import math
from pathlib import Path
import re

import pytest
import yaml

from checkweigher_core.parameters import SettingsError
from checkweigher_core.records import ProductOnLine
from checkweigher_core.settings_files import plain, settings_of
from checkweigher_production.recipes import (
    Product,
    change_recipe,
    given_recipes,
    product_of,
    read_recipes,
    replace_recipes,
)

EXACT = 1e-12  # relative
GOOD = {
    'nominal': 0.15,
    'tare': 0.004,
    'lower_limit': 'TU1',
    'upper_limit': 0.165,
    'length': [0.08, 0.12],
    'speed': [0.5, 1.5],
    'parameters': {'identifier': {'estimator': 'hann', 'hann': {'gain': [1.01]}}},
}
TEST = {'mass': 0.154, 'limit': 0.0005, 'every_hours': 8}


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / 'recipes.yaml'
    path.write_text(text, encoding='utf-8')
    return path


@pytest.mark.parametrize(
    ('given', 'net'),
    # 150 g: the tolerable negative error is 4.5 %, 6.75 g, rounded up to 6.8 g.
    [('TU1', 0.1432), ('TU2', 0.1364), (0.14, 0.14)],
)
def test_the_reject_node_gets_the_limits_with_the_packaging_on(given: object, net: float):
    product = settings_of(Product, {**GOOD, 'lower_limit': given}, 'crisps')
    reject = product.limits()
    assert product.lower_limit == pytest.approx(net, rel=EXACT)
    assert reject['lower_limit'] == pytest.approx(net + 0.004, rel=EXACT)
    assert reject['upper_limit'] == pytest.approx(0.169, rel=EXACT)
    assert (reject['min_length'], reject['max_length']) == (0.08, 0.12)
    assert (reject['min_speed'], reject['max_speed']) == (0.5, 1.5)


def test_where_the_directive_has_no_row_there_is_no_tu1():
    assert math.isnan(settings_of(Product, {'nominal': 25.0}, 'sack').tu1)
    with pytest.raises(SettingsError, match=r'sack\.lower_limit: 76/211/EEC has no TU1 .* 25 kg'):
        settings_of(Product, {'nominal': 25.0, 'lower_limit': 'TU1'}, 'sack')
    own = {'nominal': 25.0, 'tu1': 24.9}
    assert settings_of(Product, {**own, 'lower_limit': 'TU1'}, 'sack').lower_limit == 24.9
    with pytest.raises(SettingsError, match=r'sack\.lower_limit: 76/211/EEC has no TU2 .* 25 kg'):
        settings_of(Product, {**own, 'lower_limit': 'TU2'}, 'sack')
    with pytest.raises(SettingsError, match=r'sack\.tu1_quota: needs TU1 and TU2'):
        settings_of(Product, {**own, 'lower_limit': 'TU2', 'tu1_quota': 0.02}, 'sack')


def test_what_is_not_given_is_no_limit():
    product = settings_of(Product, {'nominal': 0.15}, 'crisps')
    assert product.parameters == {}
    assert product.on_line('b7') == ProductOnLine(0, 'crisps', 'b7', needed=True, nominal=0.15)
    assert product.length == product.speed == (0.0, math.inf)


def test_the_reject_node_gets_the_rules_of_the_batch_with_the_packaging_on():
    rules = {'tu1_quota': 0.02, 'mean_value': True, 'filler': {'max_correction': 0.004}}
    product = settings_of(Product, {**GOOD, **rules, 'lower_limit': None}, 'crisps')
    reject = product.limits()
    weights = reject['lower_limit'], reject['tu1'], reject['nominal']
    assert weights == pytest.approx((0.1404, 0.1472, 0.154), rel=EXACT)  # TU2, TU1, nominal
    assert (reject['tu1_quota'], reject['mean_value']) == (0.02, True)
    assert product.filler.max_correction == 0.004


def test_the_guard_of_a_recipe_is_a_parameter_of_the_reject_node():
    product = settings_of(Product, {**GOOD, 'guard': {'risk': 0.01}}, 'crisps')
    assert product.stage_values()['reject.guard_risk'] == 0.01
    assert product_of({'name': 'crisps', **plain(product)}) == product  # as records have it
    with pytest.raises(SettingsError, match='risk'):
        settings_of(Product, {**GOOD, 'guard': {'risk': 0.6}}, 'crisps')


@pytest.mark.parametrize(
    ('recipe', 'std_dev', 'said'),
    [
        ({}, 0.0006, ''),  # tolerable negative error of 150 g: 6.8 g
        ({}, 0.0007, 'twice the stated deviation, 1.40 g, is above a fifth .*, 1.36 g'),
        ({'lower_limit': 0.149}, 0.0003, ''),
        ({'lower_limit': 0.149}, 0.0004, r'0.40 g, is too large for limits 1.00 g'),
        ({'upper_limit': 0.151}, 0.0004, r'0.40 g, is too large for limits 1.00 g'),
        ({'lower_limit': 0.149, 'guard': {'risk': 1e-4}}, 0.0003, r'0.30 g, is too large'),
        ({'lower_limit': 0.149}, math.nan, ''),
    ],
)
def test_a_recipe_that_the_scale_cannot_resolve_says_why(recipe, std_dev, said):
    product = settings_of(Product, {'nominal': 0.15, **recipe}, 'crisps')
    assert re.search(said, product.unresolved(std_dev))
    assert bool(product.unresolved(std_dev)) == bool(said)


def test_a_test_product_and_a_target_may_be_up_to_half_off():
    inner = {
        'test': {**TEST, 'mass': 0.23, 'limit': 0.0229},  # of 154 g with the packaging
        'filler': {'max_correction': 0.15, 'target': 0.076},
    }
    product = settings_of(Product, {**GOOD, **inner}, 'crisps')
    assert product.test.mass == 0.23
    assert product.parameters['identifier'] == {'estimator': 'hann', 'hann.gain': (1.01,)}
    assert product_of({'name': 'crisps', **plain(product)}) == product


@pytest.mark.parametrize(
    ('key', 'value', 'complaint'),
    [
        ('nominal', '150 g', "crisps.nominal: '150 g' is not a number"),
        ('nominal', 0.0, 'crisps.nominal: must be above 0'),
        ('nominal', None, 'crisps.nominal: is missing'),
        ('nominal', -0.1, 'crisps.nominal: -0.1 is not in'),
        ('tare', -0.001, 'crisps.tare: -0.001 is not in 0..10000 kg'),
        ('lower_limit', 0.151, 'crisps.lower_limit: 0.151 kg is above nominal, 0.15 kg'),
        ('lower_limit', 'TU3', "crisps.lower_limit: 'TU3' is not a number"),
        ('upper_limit', 0.149, 'crisps.upper_limit: 0.149 kg is below nominal, 0.15 kg'),
        ('length', 0.1, 'crisps.length: 0.1 is not a list like [a, b]'),
        ('length', [0.12, 0.08], 'crisps.length: from 0.12 to 0.08 nothing would be weighed'),
        ('speed', [0.5, 'fast'], "crisps.speed: 'fast' is not a number"),
        ('reason', 'yes', "crisps.reason: 'yes' is not true or false"),
        ('colour', 'red', 'crisps.colour: no such key'),
        ('tu1_quota', 0.025, 'crisps.tu1_quota: the quota is for items from TU2 to TU1'),
        ('filler', 3, 'crisps.filler: 3 is not'),
        ('test', {'mass': 0.2}, 'crisps.test.limit: must be given'),
        ('test', {**TEST, 'mass': 150.0}, 'crisps.test.mass: 150 kg differs by more than half'),
        ('test', {**TEST, 'limit': 0.016}, 'crisps.test.limit: 0.016 kg is not below'),
        (
            'filler',
            {'max_correction': 0.004, 'target': 150.0},
            'crisps.filler.target: 150 kg differs by more than half',
        ),
        ('filler', {'max_correction': 4.0}, 'crisps.filler.max_correction: 4 kg is above nominal'),
        ('filler', {'gain': 0.1}, 'crisps.filler.max_correction: 0.0, must be above 0 kg'),
        ('filler', {'gain': 2}, 'crisps.filler.gain: 2'),
        ('parameters', {'segmenter': {'lead_time': 1.0}}, 'crisps.parameters.segmenter: no recipe'),
        ('parameters', {'reject': 3}, 'crisps.parameters.reject: 3 is not'),
        ('parameters', {'reject': {'lower_limit': 0.1}}, 'crisps.parameters.reject.lower_limit'),
        ('parameters', {'reject': {'needs_product': 0}}, 'crisps.parameters.reject.needs_product'),
        ('parameters', {'denoise': {'strech': 9}}, 'crisps.parameters.denoise.strech: denoise has'),
        (
            'parameters',
            {'identifier': {'hann': {'gain': 1.0}}},
            'crisps.parameters.identifier.hann.gain: 1.0 is not a list',
        ),
    ],
)
def test_a_bad_recipe_is_refused_with_the_key_and_the_value(
    key: str, value: object, complaint: str
):
    with pytest.raises(SettingsError) as error:
        settings_of(Product, {**GOOD, key: value}, 'crisps')
    assert str(error.value).startswith(complaint)


def test_a_file_comes_back_as_it_was_written(tmp_path: Path):
    with pytest.raises(SettingsError, match='No such file'):
        read_recipes(tmp_path / 'recipes.yaml')
    path = write(tmp_path, yaml.safe_dump({'products': {'crisps': GOOD, 'nuts': {'nominal': 1}}}))
    assert read_recipes(path) == {
        'crisps': settings_of(Product, GOOD, 'crisps'),
        'nuts': Product('nuts', 1.0, tu1=0.985, tu2=0.97),
    }


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('', 'line 1: None is not a table with products'),
        ('products: {}', 'line 1: products: is missing'),
        ('products: [1]', r'line 1: products: \[1\] is not a table'),
        ('products: {a: {nominal: 0.1}}\nlines: 3', 'line 2: lines: no such key; .* products$'),
        (
            'products:\n  a: {nominal: 0.1}\n  b:\n    nominal: x\n',
            r"4: products\.b\.nominal: 'x' is",
        ),
        ('products: {a: {nominal: 0.1}, a: {nominal: 0.2}}', 'line 1: .* a is there twice'),
        ('products: {7: {nominal: 0.1}}', r'products\.7: 7 is not .* put it in quotes'),
        ('products: {a: {nominal: 1, parameters: {denoise: &x {y: *x}}}}', 'line 1: .* recursive'),
        (r'products: {"\e[2J": {nominal: 0.1}}', r"'\\x1b\[2J' is not one line of text"),
        ('products: {a: 3}', r'products\.a: 3 is not a table with nominal, tare'),
        ('products: {? [1, 2] : {nominal: 0.1}}', 'line 1: bad YAML'),
    ],
)
def test_a_bad_file_is_refused_whole(tmp_path: Path, text: str, complaint: str):
    with pytest.raises(SettingsError, match=complaint) as error:
        read_recipes(write(tmp_path, text))
    assert str(error.value).startswith(str(tmp_path))
    assert '\n' not in str(error.value)


def test_a_file_of_a_newer_format_may_have_keys_that_are_not_known(tmp_path: Path):
    nuts = '{nominal: 0.2, colour: red, filler: {brand: x, max_correction: 0.01}}'
    text = f'format: 2\nshop: west\nproducts:\n  nuts: {nuts}\n'
    assert read_recipes(write(tmp_path, text)) == {
        'nuts': settings_of(Product, {'nominal': 0.2, 'filler': {'max_correction': 0.01}}, 'nuts')
    }
    with pytest.raises(SettingsError, match=r'line 2: shop: no such key; valid keys are products$'):
        read_recipes(write(tmp_path, text.replace('format: 2', 'format: 1')))


def test_the_recipe_in_a_record_of_before_is_read():
    """As it was written with its limits, not yet rounded, and before recipes had a test."""
    line = (
        '{"name":"crisps","nominal":0.15,"tare":0.004,"lower_limit":0.1365,'
        '"upper_limit":Infinity,"tu1":0.14325,"tu2":0.1365,"length":[0.0,Infinity],'
        '"speed":[0.5,1.5],"reason":false,"parameters":{"identifier":{"hann.gain":[1.01]}},'
        '"tu1_quota":0.02,"mean_value":false,"filler":{"target":0.0,"subgroup":10,"delay":0,'
        '"gain":0.5,"dead_band":0.0,"max_step":Infinity,"max_correction":0.004}}'
    )
    rules = {'nominal': 0.15, 'tare': 0.004, 'speed': [0.5, 1.5], 'tu1_quota': 0.02}
    rules |= {'tu1': 0.14325, 'tu2': 0.1365}
    inner = {'filler': {'max_correction': 0.004}}
    own = {'parameters': {'identifier': {'hann': {'gain': [1.01]}}}}
    product = product_of(json.loads(line))
    assert product == settings_of(Product, {**rules, **inner, **own}, 'crisps')


TWO = 'products:\n  crisps: {nominal: 0.15, lower_limit: TU1}\n  nuts: {nominal: 0.2}\n'


def test_a_recipe_is_changed_added_and_removed_as_it_was_given(tmp_path: Path):
    path = write(tmp_path, TWO)
    # YAML 1.1 would take 1:30 for a number, and 1e5 for a string.
    change_recipe(path, '1e5', {'nominal': 0.3, 'parameters': {'reject': {}}, 'reason': True})
    change_recipe(path, 'crisps', {'nominal': 0.16, 'lower_limit': 'TU1'})
    change_recipe(path, 'nuts', None)
    assert list(given_recipes(path)) == ['crisps', '1e5']
    assert given_recipes(path)['crisps'] == {'nominal': 0.16, 'lower_limit': 'TU1'}
    # 160 g: the tolerable negative error is 4.5 %, 7.2 g. TU1 follows the new nominal mass.
    assert read_recipes(path)['crisps'].lower_limit == pytest.approx(0.1528, rel=EXACT)


@pytest.mark.parametrize(
    ('name', 'keys', 'complaint'),
    [
        ('crisps', {'nominal': 0.15, 'lower_limit': 0.2}, 'crisps.lower_limit: 0.2 kg is above'),
        ('peas', None, "there is no recipe 'peas'"),
    ],
)
def test_a_change_that_is_refused_leaves_the_file(
    name: str, keys: dict[str, object] | None, complaint: str, tmp_path: Path
):
    path = write(tmp_path, TWO)
    with pytest.raises(SettingsError) as error:
        change_recipe(path, name, keys)
    assert str(error.value).startswith(complaint)
    with pytest.raises(SettingsError, match=r'line 2: products\.a\.nominal'):
        replace_recipes(path, 'products:\n  a: {nominal: much}\n')
    assert path.read_text() == TWO


def test_the_only_recipe_stays(tmp_path: Path):
    path = write(tmp_path, 'products: {crisps: {nominal: 0.15}}')
    with pytest.raises(SettingsError, match="'crisps' is the only recipe"):
        change_recipe(path, 'crisps', None)
    replace_recipes(path, f'# of the spring\n{TWO}')
    assert path.read_text().startswith('# of the spring')
