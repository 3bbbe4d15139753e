# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bad input, which gives one line on the error, exit status 2, and no partial output."""

from collections.abc import Callable
import os
from pathlib import Path
import shutil

from here import refused
from lines import simulated
import pytest
from running import BAGS

from checkweigher_recording.bags.writing import write_bag

BAG = BAGS / 'paper_90'


def flipped(data: bytes) -> bytes:
    place = len(data) // 3
    return data[:place] + bytes([data[place] ^ 0x10]) + data[place + 1 :]


@pytest.mark.parametrize('command', ['weigh', 'replay'])
class TestBags:
    def test_what_is_none(self, command: str, tmp_path: Path):
        assert 'there is no such' in refused(command, tmp_path / 'nothing')
        expected = 'no bag in this folder' if command == 'weigh' else 'not a bag'
        assert expected in refused(command, tmp_path)
        assert 'not a bag' in refused(command, __file__)

    @pytest.mark.parametrize(
        'damage', [lambda data: data[: len(data) // 2], flipped, lambda _: b'']
    )
    def test_damaged(self, command: str, damage: Callable[[bytes], bytes], tmp_path: Path):
        bag = shutil.copytree(BAG, tmp_path / 'bag')
        (file,) = bag.glob('*.mcap')
        file.write_bytes(damage(file.read_bytes()))
        assert str(bag) in refused(command, bag)

    def test_no_samples(self, command: str, tmp_path: Path):
        line = simulated(count=2)
        write_bag(tmp_path / 'bag', line.load_cell, line.edges)
        assert 'samples' in refused(command, tmp_path / 'bag')


@pytest.mark.parametrize('command', ['weigh', 'replay'])
@pytest.mark.parametrize(
    ('text', 'names'),
    [
        ('/**/reject:\n  ros__parameters: {lower_limit: .nan}', 'reject.lower_limit'),
        ('/**/segmenter:\n  ros__parameters: {zero_tme: 1.0}', 'segmenter.zero_tme'),
        ('/**/denoise:\n  ros__parameters: {gamma5: [0.1]}', 'denoise.speeds'),
        ('/**/identifier:\n  ros__parameters: {estimator: best}', 'identifier.estimator'),
        ('/**/denoise:\n  ros__parameters: {stretch: 1048576}', 'denoise.stretch'),
        ('/**/typo:\n  ros__parameters: {}', 'typo'),
        ('/**:\n  ros__parameters: {no_such_name: 1}', 'no_such_name'),
        ('just text', 'not a parameter file'),
        ('a: [', 'bad YAML'),
    ],
)
def test_parameters(command: str, text: str, names: str, tmp_path: Path):
    path = tmp_path / 'parameters.yaml'
    path.write_text(text)
    line = refused(command, BAG, '--params', path)
    assert names in line
    assert str(path) in line


@pytest.mark.parametrize(
    'arguments',
    [
        ('weigh', BAG, '--estimator', 'best'),
        ('weigh', BAG, '--params', '/no/such/file'),
        ('weigh', BAG, '--lane', 'other'),
        ('weigh', '/no/such/\x1b[31m\x07'),
        ('replay', BAG, '--listeners', '-1'),
        ('replay', BAG, '--rate', 'fast'),
        ('replay', BAG, '--namespace', '1lane'),
        ('echo', '--count', '0'),
        ('run', '--page-host', '0.0.0.0'),
        ('polish',),
        (),
    ],
)
def test_options(arguments: tuple[object, ...]):
    assert refused(*arguments).startswith('checkweigher')


@pytest.mark.parametrize(
    ('options', 'said'),
    [
        (('--port', 70000), 'is not in 0..65535'),
        (('--keep', '/nowhere/at/all'), 'there is no folder /nowhere/at/all; make it first'),
        (('--trust', __file__), f'{__file__}: is not an Ed25519 public key'),
        (('--trust', '/none'), '/none: cannot be read: No such file'),
        (('--trust', __file__, '--bag', BAG), '--trust: not with --bag'),
        (('--bag', BAG, '--report', '/none'), 'there is no such file'),
        (('--report', __file__), '--report: only with --bag'),
    ],
)
def test_pages(monkeypatch: pytest.MonkeyPatch, options: tuple[object, ...], said: str):
    monkeypatch.setenv('XDG_CONFIG_HOME', os.devnull)
    assert said in refused('page', '--port', 0, *options)


SIMULATION = ('simulate', '--speed', 60, '--mass', 100, '--count', 2)


@pytest.mark.parametrize(
    ('option', 'value'),
    {'speed': 'nan', 'count': 0, 'profile': 'moon', 'seed': -1, 'spacing': 0.05}.items(),
)
def test_simulations(option: str, value: object, tmp_path: Path):
    refused(*SIMULATION, f'--{option}', value, '--output', tmp_path / 'bag')
    assert list(tmp_path.iterdir()) == []


class TestOutputs:
    def test_a_bag_that_exists(self, tmp_path: Path):
        assert 'exists already' in refused(*SIMULATION, '--output', tmp_path)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize('command', ['weigh', 'replay'])
    def test_a_csv_that_exists(self, command: str, tmp_path: Path):
        path = tmp_path / 'masses.csv'
        path.write_text('mine')
        assert 'exists already' in refused(command, BAG, '--csv', path)
        assert path.read_text() == 'mine'
        assert 'there is no folder' in refused(command, BAG, '--csv', tmp_path / 'a' / 'b.csv')

    @pytest.mark.parametrize(
        'arguments',
        [
            (*SIMULATION, '--output'),
            ('weigh', BAG, '--csv'),
            ('record', '--duration', '0.1', '--output'),
        ],
    )
    def test_a_file_system_that_cannot_be_written(self, arguments: tuple[object, ...]):
        # Root may write into any folder, but not even root into this file system.
        assert '/proc/' in refused(*arguments, '/proc/checkweigher_output')

    def test_a_recording_of_nothing(self, tmp_path: Path):
        line = refused('record', '--duration', '0.5', '--output', tmp_path / 'bag')
        assert 'nothing was recorded' in line
        assert list(tmp_path.iterdir()) == []
