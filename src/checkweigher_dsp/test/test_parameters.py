# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters: types, ranges, and the YAML files that they come from."""

from dataclasses import dataclass, fields
import math
from typing import ClassVar

import pytest

from checkweigher_core.parameters import ParameterError, Parameters, by_node, parameter
from checkweigher_core.yaml_files import opened
from checkweigher_dsp.pipeline.line import LineParameters


@dataclass(frozen=True)
class Oven(Parameters):
    node: ClassVar[str] = 'oven'

    heat: float = parameter(20.0, 'temperature', unit='K', minimum=0, maximum=500)
    trays: int = parameter(2, 'number of trays', minimum=1, maximum=10)
    fan: bool = parameter(False, 'whether it turns')
    mode: str = parameter('bake', 'what to do', choices=('bake', 'grill'))
    profile: tuple[float, ...] = parameter((1.0, 2.0), 'shares', minimum=0, maximum=9)
    name_in_use: str = parameter('', 'any string')


@dataclass(frozen=True)
class Fridge(Parameters):
    node: ClassVar[str] = 'fridge'

    heat: float = parameter(5.0, 'temperature', minimum=-300)
    door: float = parameter(0.0, 'nested.like')


@dataclass(frozen=True)
class Shelf(Parameters):
    node: ClassVar[str] = 'larder.shelf'

    boards: int = parameter(3, 'number of boards', minimum=1, maximum=9)
    heights: tuple[float, ...] = parameter((0.3,), 'between them', unit='m', minimum=0, maximum=1)


@dataclass(frozen=True)
class Larder(Parameters):
    node: ClassVar[str] = 'larder'

    door: bool = parameter(True, 'whether it has one')
    shelf: Shelf = Shelf()


SETS = {'oven': Oven, 'fridge': Fridge}


def read(text, sets=SETS, lane=None):
    with opened(text) as sections:
        return by_node(sections, sets, ('driver',), lane)


def _refuse(text, *arguments):
    """Return the message with which a text is refused: one line."""
    with pytest.raises(ParameterError) as error:
        read(text, *arguments)
    assert '\n' not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize('heat', [0, 0.0, 500, 500.0, 37])
def test_the_range_includes_its_ends_and_whole_numbers_become_floats(heat):
    value = Oven(heat=heat).heat

    assert value == heat
    assert isinstance(value, float)


def test_a_list_becomes_a_tuple_of_floats_and_other_values_keep_their_defaults():
    oven = Oven.from_mapping({'profile': [1, 2]})
    assert oven == Oven(20.0, 2, False, 'bake', (1.0, 2.0))
    assert all(isinstance(value, float) for value in oven.profile)


@pytest.mark.parametrize(
    ('name', 'value', 'complaint'),
    [
        ('heat', math.nan, 'nan is not in 0..500 K'),
        ('heat', -0.1, '-0.1 is not in 0..500 K'),
        ('heat', 500.1, '500.1 is not in 0..500 K'),
        ('heat', math.inf, 'inf is not in'),
        ('heat', 10**400, 'is not in 0..500 K'),
        ('heat', '20', "'20' is not a number"),
        ('heat', True, 'True is not a number'),
        ('heat', None, 'None is not a number'),
        ('trays', 2.0, '2.0 is not a whole number'),
        ('trays', True, 'True is not a whole number'),
        ('trays', 0, '0 is not in 1..10'),
        ('trays', 10**400, 'is not in 1..10'),
        ('fan', 1, '1 is not true or false'),
        ('fan', 'yes', "'yes' is not true or false"),
        ('mode', 'boil', "'boil' is not one of bake, grill"),
        ('mode', 3, '3 is not a string'),
        ('mode', 'x' * 100_000, "xxx' is not one of bake, grill"),
        ('profile', 1.0, '1.0 is not a list of numbers'),
        ('profile', '12', "'12' is not a list of numbers"),
        ('profile', [1.0, math.nan], 'nan is not in 0..9'),
        ('profile', [1.0, 9.5], '9.5 is not in 0..9'),
        ('profile', ['a'], "'a' is not a number"),
        ('profile', (1.0,) * 100_001, '100001 values, but at most 100000'),
    ],
    ids=lambda value: str(value)[:20],
)
def test_a_wrong_value_is_refused_with_its_name_and_what_is_allowed(name, value, complaint):
    with pytest.raises(ParameterError) as error:
        Oven.from_mapping({name: value})

    assert str(error.value).startswith(f'oven.{name}: ')
    assert complaint in str(error.value)
    assert len(str(error.value)) < 500


def test_a_number_without_a_limit_must_still_be_a_float():
    with pytest.raises(ParameterError, match=r'^fridge\.heat: '):
        Fridge(heat=10**400)


def test_an_unknown_name_is_refused_with_the_names_there_are():
    with pytest.raises(ParameterError, match=r'^oven\.haet: no such parameter.*heat.*trays'):
        Oven.from_mapping({'heat': 3.0, 'haet': 3.0})


def test_a_section_for_all_nodes_reaches_those_that_know_the_name():
    values = read('/**:\n  ros__parameters: {heat: 7.0, trays: 4, use_sim_time: true}\n')

    assert values == {'oven': {'heat': 7.0, 'trays': 4}, 'fridge': {'heat': 7.0}}


@pytest.mark.parametrize('address', ['oven', '/oven', '/**/oven', '/lane1/oven'])
def test_a_section_of_a_node_reaches_it_alone(address):
    assert read(f'{address}:\n  ros__parameters: {{heat: 7.0}}\n') == {
        'oven': {'heat': 7.0},
        'fridge': {},
    }


def test_a_section_of_a_node_wins_wherever_it_stands():
    own = '/**/oven:\n  ros__parameters: {heat: 1.0}\n'
    shared = '/**:\n  ros__parameters: {heat: 2.0}\n'

    for text in (own + shared, shared + own):
        assert read(text) == {'oven': {'heat': 1.0}, 'fridge': {'heat': 2.0}}


def test_nested_names_are_joined_by_dots():
    text = 'oven:\n  ros__parameters:\n    a:\n      b: {c: 1}\n      d: 2\n'

    assert read(text)['oven'] == {'a.b.c': 1, 'a.d': 2}


def test_other_nodes_may_be_addressed_and_are_passed_over():
    text = '/**/driver:\n  ros__parameters: {whatever: 1}\noven:\n  ros__parameters: {trays: 4}\n'

    assert read(text) == {'oven': {'trays': 4}, 'fridge': {}}


def test_a_parameter_of_every_node_may_stand_in_a_section_of_its_own():
    assert read('oven:\n  ros__parameters: {use_sim_time: true}\n')['oven'] == {}
    qos = 'qos_overrides: {/heat: {publisher: {depth: 5}}}'
    assert read(f'oven:\n  ros__parameters: {{{qos}}}\n')['oven'] == {}


NO_PARAMETERS = 'line 1: oven: has no ros__parameters'


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        (
            '/**/ovne:\n  ros__parameters: {heat: 7.0}\n',
            'line 1: /**/ovne: addresses none of oven, fridge, driver',
        ),
        ('/**:\n  ros__parameters: {haet: 7.0}\n', 'haet'),
        ('oven: {heat: 7.0}\n', NO_PARAMETERS),
        ('oven:\n', NO_PARAMETERS),
        ('oven:\n  ros__parameters: [1, 2]\n', NO_PARAMETERS),
        ('oven:\n  ros_parameters: {heat: 1.0}\n', NO_PARAMETERS),
        ('a: b: c\n', 'bad YAML'),
        ('', 'not a parameter file'),
        ('- 1\n- 2\n', 'not a parameter file'),
    ],
)
def test_what_is_no_parameter_file_of_these_nodes_is_refused(text, complaint):
    assert complaint in _refuse(text)


def test_parameters_of_an_inner_set_are_named_with_a_dot():
    assert list(Larder.entries()) == ['door', 'shelf.boards', 'shelf.heights']
    assert Larder.entries()['shelf.boards'].default == 3
    assert Larder().as_mapping() == {'door': True, 'shelf.boards': 3, 'shelf.heights': (0.3,)}


def test_every_parameter_of_the_line_makes_the_same_set_again():
    for entry in fields(LineParameters):
        parameters = entry.default
        assert list(parameters.entries()) == list(parameters.as_mapping())
        assert parameters.from_mapping(parameters.as_mapping()) == parameters


@pytest.mark.parametrize(
    ('values', 'complaint'),
    [
        ({'shelf.boards': 10}, r'^larder\.shelf\.boards: 10 is not in 1\.\.9$'),
        ({'shelf.heights': [0.1, 2.0]}, r'^larder\.shelf\.heights: 2\.0 is not in 0\.\.1 m$'),
        ({'shelf.boards': 3.0}, r'^larder\.shelf\.boards: 3\.0 is not a whole number$'),
        ({'shelf.bords': 3}, r'^larder\.shelf\.bords: no such .* shelf\.boards, shelf\.heights$'),
        ({'shelf': 3}, r'^larder\.shelf: no such parameter; larder has door, shelf\.\*$'),
        ({'boards': 3}, r'^larder\.boards: no such parameter; larder has door, shelf\.\*$'),
        ({'shlef.boards': 3}, r'^larder\.shlef\.boards: no such .* has door, shelf\.\*$'),
        ({'shelf.boards.top': 3}, r'^larder\.shelf\.boards\.top: no such parameter'),
    ],
    ids=str,
)
def test_a_wrong_inner_value_is_refused_with_its_whole_name(values, complaint):
    with pytest.raises(ParameterError, match=complaint):
        Larder.from_mapping(values)


@pytest.mark.parametrize(
    'section',
    [
        '{shelf: {boards: 5, heights: [0.1, 0.2]}}',
        '{shelf.boards: 5, shelf.heights: [0.1, 0.2]}',
        '{shelf: {boards: 5}, shelf.heights: [0.1, 0.2]}',
    ],
)
@pytest.mark.parametrize('address', ['/**', 'larder', '/**/larder'])
def test_a_file_names_inner_parameters_nested_or_with_a_dot(address, section):
    values = read(f'{address}:\n  ros__parameters: {section}\n', {'larder': Larder, 'oven': Oven})

    assert values['oven'] == {}
    assert Larder.from_mapping(values['larder']) == Larder(True, Shelf(5, (0.1, 0.2)))


def test_an_inner_name_for_all_that_none_knows_is_refused():
    text = '/**:\n  ros__parameters: {shelf: {bords: 5}}\n'
    message = _refuse(text, {'larder': Larder})
    assert 'line 2: ' in message
    assert 'none of larder has a parameter shelf.bords' in message


LANES = """
/**: {ros__parameters: {door: false}}
/left/larder: {ros__parameters: {shelf: {boards: 4}}}
/right/larder: {ros__parameters: {shelf: {boards: 5}}}
"""


@pytest.mark.parametrize(('lane', 'boards'), [('left', 4), ('/right', 5), ('cellar', 3)])
def test_of_several_lanes_the_one_that_is_asked_for_is_read(lane, boards):
    values = read(LANES, {'larder': Larder}, lane=lane)

    assert Larder.from_mapping(values['larder']) == Larder(False, Shelf(boards))


def test_of_several_lanes_none_is_taken_by_chance():
    sets = {'larder': Larder}
    message = _refuse(LANES, sets)
    assert 'line 1: the file addresses several lanes: left, right; choose one' in message
    message = _refuse(LANES.replace('right', 'left/cellar'), sets)
    assert 'several lanes: left, left/cellar; choose one' in message
    assert read(LANES.partition('/right')[0], sets)['larder']['shelf.boards'] == 4


TOO_LONG = '.* s per item.* lower it'
ONE_STATION = {'station_distances': (1.0,), 'station_delays': (0.0,)}


@pytest.mark.parametrize(
    ('node', 'values', 'complaint'),
    [
        ('segmenter', {'min_belt_speed': 3, 'max_belt_speed': 2}, 'min_belt_speed: 3 is not below'),
        ('denoise', {'gamma6': (0.1, 0.2)}, 'speeds: each .* needs 5 values, one per speed, not 2'),
        ('denoise', {'speeds': (1.5, 1.25, 1.0, 0.75, 0.5)}, 'speeds: at least one speed'),
        ('denoise', {'speeds': (0.5, 0.75, 0.75, 1.0, 1.25)}, 'speeds: at least one speed'),
        ('denoise', {'speeds': ()}, 'speeds: at least one speed'),
        ('denoise', {'lambda7': (1.0, 2.0, math.inf, 4.0, 5.0)}, 'lambda7: .*finite'),
        ('denoise', {'gamma5': (0.1, -0.2, 0.1, 0.1, 0.1)}, r'gamma5: -0\.2 is not in 0\.\.10'),
        ('denoise', {'natural_frequency': (38.0, 39.0)}, 'natural_frequency: 2 values, but 1'),
        ('denoise', {'damping_ratio': ()}, 'damping_ratio: 0 values, but 1 or 5'),
        # What would take too long, with the parameter to lower.
        (
            'denoise',
            {'stretch': 2**20, 'prediction_order': 1000, 'iterations': 100},
            f'iterations: {TOO_LONG}',
        ),
        ('denoise', {'stretch': 2**20}, f'stretch: {TOO_LONG}'),
        ('denoise', {'iterations': 100}, f'iterations: {TOO_LONG}'),
        ('denoise', {'prediction_order': 1000, 'iterations': 10}, f'prediction_order: {TOO_LONG}'),
        ('identifier.mean', {'speeds': ()}, 'speeds: at least one speed is needed'),
        ('identifier.mean', {'speeds': (1.0, 1.0)}, 'speeds: at least one speed is needed, in'),
        ('identifier.mean', {'speeds': (0.5, 1.0)}, 'gain: 1 values for 2 speeds'),
        ('identifier.mean', {'offset': (0.0, 0.0)}, 'offset: 2 values for 1 speeds'),
        ('identifier.mean', {'heaviest_mass': (1.0, 1.0)}, 'heaviest_mass: 2 values for 1 speeds'),
        ('identifier.mean', {'gain': (0.0,)}, r'gain: 0\.0 is not in 0\.1\.\.10'),
        ('identifier.mean', {'std_dev': (-1.0,)}, r'std_dev: -1\.0 is not in'),
        ('identifier.gauss_markov', {'reflection': (1.0,), 'order': 1}, 'reflection: must lie'),
        ('identifier.gauss_markov', {'reflection': (0.1,), 'order': 2}, 'reflection: 1 values'),
        ('identifier.gauss_markov', {'noise': (1e-5, 1e-5)}, 'noise: 2 values for 1 speeds'),
        ('identifier.gauss_markov', {'speeds': (1.0, 2.0)}, r'\w+: \d values for 2 speeds'),
        ('identifier.learned', {'parts': 8, 'weights_alone': (1.0,) * 8}, 'weights: 1 values'),
        (
            'reject',
            {'inspections': 'a', 'inspection_distances': (1,)},
            'inspection_times: 0 values',
        ),
        (
            'reject',
            {'inspections': 'a a', 'inspection_distances': (1, 2), 'inspection_times': (0, 0)},
            'inspections: .* names a device twice',
        ),
        ('reject', {'stations': 'UNDER; OVER', **ONE_STATION}, 'station_distances: 1 values, but'),
        ('reject', {'stations': 'HEAVY', **ONE_STATION}, r"stations\[0\]: 'HEAVY' is not"),
        ('reject', {'stations': 'ACCEPT', **ONE_STATION}, r"stations\[0\]: 'ACCEPT' is not"),
        (
            'reject',
            {'stations': '0.2..0.1', **ONE_STATION},
            r'stations\[0\]: .* is not a mass range',
        ),
        (
            'reject',
            {'stations': 'UNDER; ', 'station_distances': (1, 2), 'station_delays': (0, 0)},
            r'stations\[1\]: must state what',
        ),
    ],
)
def test_values_that_do_not_go_together_are_refused_by_name(node, values, complaint):
    with pytest.raises(ParameterError, match=rf'^{node}\.{complaint}'):
        LineParameters().with_values({f'{node}.{name}': value for name, value in values.items()})
