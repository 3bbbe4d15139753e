# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of settings and state files, on valid and invalid content and on interrupted writing."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
import json
import math
import os
from pathlib import Path
from typing import ClassVar

from full_disk import file_size_limit
import numpy as np
from numpy.typing import NDArray
import pytest

from checkweigher_core.parameters import Parameters, SettingsError, parameter
from checkweigher_core.settings_files import Settings, plain, read_settings, write_settings


class Colour(Enum):
    WHITE = 1
    BROWN = 2


@dataclass(frozen=True)
class Oven(Parameters):
    node: ClassVar[str] = 'oven'

    heat: float = parameter(200.0, 'temperature', unit='degC', maximum=300)


@dataclass(frozen=True)
class Egg(Settings):
    name: str = parameter(text='of the hen')
    mass: float = parameter(text='mass', unit='kg', minimum=0, maximum=0.1, choices=('small',))
    colour: Colour = parameter(Colour.WHITE, 'of the shell', choices=('white', 'brown'))

    def __post_init__(self) -> None:
        if self.mass == 0.1:
            raise SettingsError('is that of a goose', 'mass')


@dataclass(frozen=True)
class Step(Settings):
    what: str = parameter(text='to be done')
    span: tuple[float, float] = parameter((0.0, math.inf), 'from and to', unit='s', minimum=0)


@dataclass(frozen=True)
class Cake(Settings):
    format: ClassVar[int] = 2

    eggs: Mapping[str, Egg] = parameter(text='eggs')
    steps: tuple[Step, ...] = parameter((), 'steps')
    words: tuple[str, ...] = parameter((), 'what it is called')
    oven: Oven | None = parameter(None, 'oven')
    sugar: float = parameter(math.nan, 'sugar; NaN for none', unit='kg', minimum=0)
    layers: int = parameter(3, 'layers', minimum=1, maximum=9)
    class_: str = parameter('', 'kind of cake')
    taste: NDArray[np.float64] = parameter(None, 'by the tasters')

    @classmethod
    def prepared(cls, content: object) -> object:
        return {'eggs': content} if isinstance(content, str) else content


CAKE = """\
format: 2
eggs:
  berta: {mass: 0.06}
  clara:
    mass: small
    colour: brown
steps:
  - what: beat
    span: [0, 90]
  - what: bake
words: [cake, 2026-05-01]
oven: {heat: 180}
class: sponge
taste: [1, 2.5]
"""


def test_a_file_becomes_tables_lists_and_values():
    cake = read_settings(CAKE, Cake)

    assert cake.eggs == {'berta': Egg('berta', 0.06), 'clara': Egg('clara', 'small', Colour.BROWN)}
    assert cake.steps == (Step('beat', (0.0, 90.0)), Step('bake'))
    assert cake.words == ('cake', '2026-05-01')
    assert cake.oven == Oven(180.0)
    assert cake.class_ == 'sponge'
    assert (cake.layers, cake.sugar) == (3, math.nan)  # the same NaN object as the default
    assert cake.taste.tolist() == [1.0, 2.5]


def test_what_is_written_is_what_is_read(tmp_path: Path):
    path = tmp_path / 'cake'
    for mode in (0o600, 0o644):
        write_settings(path, read_settings(CAKE, Cake), mode)
        assert os.stat(path).st_mode & 0o777 == mode
    assert plain(read_settings(path, Cake)) == plain(read_settings(CAKE, Cake))
    assert json.loads(path.read_text())['format'] == 2
    assert os.listdir(tmp_path) == ['cake']


def test_unknown_fields_of_a_newer_format_are_written_again(tmp_path: Path):
    path = tmp_path / 'cake'
    text = CAKE.replace('format: 2', 'format: 3\nicing: thick')
    path.write_text(text.replace('mass: small', 'mass: small\n    yolks: 2'))

    write_settings(path, replace(read_settings(path, Cake), layers=4))

    content = json.loads(path.read_text())
    assert (content['format'], content['icing'], content['layers']) == (3, 'thick', 4)
    assert content['eggs']['clara'] == {'mass': 'small', 'colour': 'brown', 'yolks': 2}


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('    colour: brown', '    color: brown', 'line 6: eggs.clara.color: no such key'),
        ('format: 2', 'format: 1\nicing: thick', 'line 2: icing: no such key; valid keys are eggs'),
        ('format: 2', 'format: two', "line 1: format: 'two' is not a format number"),
        ('    mass: small', '    # none', 'line 4: eggs.clara.mass: is missing'),
        ('    mass: small', '    mass: big', "line 5: eggs.clara.mass: 'big' is not a number"),
        ('    mass: small', '    mass: 0.1', 'line 5: eggs.clara.mass: is that of a goose'),
        ('    mass: small', '    mass: 60', 'line 5: eggs.clara.mass: 60 is not in 0..0.1 kg'),
        ('    mass: small', '    mass: 1\n    mass: 2', 'line 6: bad YAML: mass is there twice'),
        ('  clara:', '  7:', 'line 4: eggs.7: 7 is not one line of text; put it in quotes'),
        ('    span: [0, 90]', '    span: [0]', 'line 9: steps.1.span: [0] is not a list like'),
        ('  - what: bake', '  - 3', 'line 10: steps.2: 3 is not a table with what, span'),
        ('words: [cake,', 'words: [7,', 'line 11: words.1: 7 is not one line of text'),
        ('{heat: 180}', '{heat: 400}', 'line 12: oven.heat: 400 is not in -inf..300 degC'),
        ('oven: {heat: 180}', 'oven: hot', "line 12: oven: 'hot' is not a table"),
        ('brown', 'green', "line 6: eggs.clara.colour: 'green' is not one of white, brown"),
        ('taste: [1, 2.5]', 'taste: [1, sweet]', "line 14: taste: 'sweet' is not a number"),
        ('taste: [1, 2.5]', 'taste: [1', 'line 15: bad YAML: '),
        ('mass: 0.06', 'mass: 1:30', "line 3: eggs.berta.mass: '1:30' is not a number; "),
        ('mass: 0.06', 'mass: !!int 0o6', 'line 3: bad YAML: tags such as !!int are not supported'),
        ('mass: 0.06', 'mass: 006', "line 3: eggs.berta.mass: '006' is not a number"),
        ('mass: 0.06', 'mass: 00.6', "line 3: eggs.berta.mass: '00.6' is not a number"),
        ('mass: 0.06', 'mass: 0_06', "line 3: eggs.berta.mass: '0_06' is not a number"),
        ('eggs:\n', 'eggs: &a\n  anna: *a\n', 'line 2: bad YAML: found unconstructable recursive'),
    ],
)  # fmt: skip
def test_a_refusal_is_one_line_with_file_line_field_and_advice(
    tmp_path: Path, old: str, new: str, message: str
):
    path = tmp_path / 'cake.yaml'
    assert old in CAKE
    path.write_text(CAKE.replace(old, new, 1))

    with pytest.raises(SettingsError) as caught:
        read_settings(path, Cake)

    assert str(caught.value).startswith(f'{path}: {message}')
    assert '\n' not in str(caught.value)


def test_what_is_no_file_or_no_text_is_refused(tmp_path: Path):
    (tmp_path / 'picture').write_bytes(b'\n\xff\xd8')
    (tmp_path / 'deep').write_text('{"a":' + 16_000 * '[')
    for name, what in (
        ('none', 'No such file'),
        ('.', 'directory'),
        ('picture', 'line 2: not UTF-8'),
        ('deep', 'nested too deeply'),
    ):
        with pytest.raises(SettingsError, match=what) as caught:
            read_settings(tmp_path / name, Cake)
        assert str(caught.value).startswith(f'{tmp_path / name}: ')


def test_numbers_are_those_of_yaml_1_2():
    text = '{eggs: {a: {mass: 6e-2}}, words: [1:30, 007], taste: [0x10, 0o17, +.5, -1.E+1, .inf]}'
    cake = read_settings(text, Cake)
    assert (cake.eggs['a'].mass, cake.words) == (0.06, ('1:30', '007'))
    assert cake.taste.tolist() == [16, 15, 0.5, -10, math.inf]


def test_flow_style_is_yaml_and_json_has_lines_too():
    assert read_settings('{"eggs": {anna: {mass: 0.05}}}', Cake).eggs['anna'].mass == 0.05
    with pytest.raises(SettingsError, match='line 2: bad YAML'):
        read_settings('{"eggs":\n{"anna" {"mass": 0.05}}}', Cake)
    with pytest.raises(SettingsError, match=r"line 2: eggs.anna.mass: 'big' is not a number"):
        read_settings('{"eggs":\n{"anna": {"mass": "big"}}}', Cake)
    with pytest.raises(SettingsError, match='line 1: bad YAML: layers is there twice'):
        read_settings('{"eggs": {"anna": {"mass": 0.05}}, "layers": 2, "layers": 3}', Cake)


def test_an_older_format_is_translated():
    with pytest.raises(SettingsError, match=r"line 1: eggs: 'three' is not a table"):
        read_settings('three', Cake)


def test_a_write_that_breaks_off_leaves_the_old_file_whole(tmp_path: Path):
    path = tmp_path / 'cake'
    old = read_settings(CAKE, Cake)
    write_settings(path, old)
    before = path.read_bytes()

    with file_size_limit(100), pytest.raises(OSError, match=r'No space left|too large'):
        write_settings(path, replace(old, words=('long',) * 100))

    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ['cake']


def test_a_link_stays_one(tmp_path: Path):
    (tmp_path / 'link').symlink_to('cake')
    write_settings(tmp_path / 'link', read_settings(CAKE, Cake))
    assert (tmp_path / 'link').is_symlink()
    assert (tmp_path / 'cake').is_file()
