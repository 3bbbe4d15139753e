# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path
from typing import Any

import pytest
import yaml

from checkweigher_bringup.hosts.description import LineDescription, read_line
from checkweigher_core.parameters import SettingsError
from checkweigher_core.ros.ports import NODES

MACHINE = ['reject', 'driver', 'segmenter']
REST = ['product', 'denoise', 'identifier']


def content() -> dict[str, Any]:
    return {
        'hosts': {'hall': '10.75.0.1', 'server': '10.75.0.2'},
        'lanes': {
            'lane1': {'host': 'hall', 'params': 'own.yaml'},
            'lane2': {
                'nodes': {'hall': MACHINE, 'server': REST},
                'recipes': "o'brien.yaml",
                'product': 'soup',
            },
        },
    }


def read(folder: Path, line: object) -> LineDescription:
    for name in ('own.yaml', "o'brien.yaml"):
        (folder / name).touch()
    path = folder / 'line.yaml'
    path.write_text(line if isinstance(line, str) else yaml.safe_dump(line))
    return read_line(path)


def test_each_host_has_its_share(tmp_path: Path):
    line = read(tmp_path, content())
    whole, part = line.shares('hall')
    assert (whole.name, whole.nodes) == ('lane1/line', tuple(NODES))
    assert whole.params == (tmp_path / 'own.yaml',)
    assert not whole.product
    assert (part.name, part.nodes) == (
        'lane2/driver+segmenter+reject',
        ('driver', 'segmenter', 'reject'),
    )
    (other,) = line.shares('server')
    assert other.nodes == ('product', 'denoise', 'identifier')
    assert {*part.nodes, *other.nodes} == set(NODES)
    assert other.product == {'recipes': str(tmp_path / "o'brien.yaml"), 'product': 'soup'}


def test_hosts_find_each_other_and_no_others(tmp_path: Path):
    line = read(tmp_path, content())
    assert line.environment() == {
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_STATIC_PEERS': '10.75.0.1;10.75.0.2',
    }
    line = read(tmp_path, {**content(), 'discovery': 'server'})
    assert line.environment()['ROS_DISCOVERY_SERVER'] == '10.75.0.2:11811'
    line = read(tmp_path, {**content(), 'discovery': 'subnet'})
    assert line.environment() == {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    one = {'hosts': {'hall': '10.75.0.1'}, 'lanes': {'lane1': {'host': 'hall'}}}
    assert read(tmp_path, one).environment() == {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


def test_a_host_that_is_not_there(tmp_path: Path):
    with pytest.raises(SettingsError, match=r'host attic: .* it has hall, server'):
        read(tmp_path, content()).shares('attic')


def changed(path: str, value: object) -> dict[str, Any]:
    line = content()
    *way, last = path.split('.')
    place = line
    for name in way:
        place = place[name]
    if value is None:
        del place[last]
    else:
        place[last] = value
    return line


@pytest.mark.parametrize(
    ('line', 'message'),
    [
        ('[', 'line 1: bad YAML'),
        ('hosts: {}\nhosts: {}', 'line 2: .* hosts is there twice'),
        ('- 1', 'line 1: .* is not a table with hosts, lanes, discovery'),
        (changed('hosts', None), 'hosts: is missing'),
        (changed('hots', {}), 'line 4: hots: no such key; valid keys are hosts, lanes, discovery'),
        (changed('hosts.hall', 'hall.local'), "hosts.hall: 'hall.local' is not an IP address"),
        (changed('hosts.hall', '10.75.0.2'), 'have the same address 10.75.0.2'),
        (changed('discovery', 'everywhere'), "discovery: 'everywhere' is not one of hosts, subnet"),
        (changed('lanes.1', {'host': 'hall'}), "lanes.1: '1' must begin with a"),
        (changed('lanes.lane1.host', 'attic'), "lanes.lane1.host: 'attic' is not one of the hosts"),
        (changed('lanes.lane1.nodes', {}), 'must have either host .* or nodes'),
        (changed('lanes.lane1.params', 3), 'lanes.lane1.params: 3 is not a list'),
        (changed('lanes.lane1.params', 'no.yaml'), 'lanes.lane1.params: there is no file'),
        (changed('lanes.lane1.product', 'soup'), 'lanes.lane1.product: .* recipes'),
        (changed('lanes.lane2.nodes.hall', ['driver']), 'no host runs segmenter, reject'),
        (
            changed('lanes.lane2.nodes', {'hall': MACHINE[:2], 'server': [MACHINE[2], *REST]}),
            'lanes.lane2.nodes: driver, segmenter, reject are on several hosts; put all on the',
        ),
        (changed('lanes.lane2.nodes.hall', ['drive']), "'drive' is not one of driver, product"),
        (
            changed('lanes.lane2.nodes.server', ['driver', *REST]),
            'lanes.lane2.nodes.hall: driver is listed twice',
        ),
    ],
)
def test_what_cannot_be_used_is_one_line(line: object, message: str, tmp_path: Path):
    with pytest.raises(SettingsError, match=message) as error:
        read(tmp_path, line)
    assert str(error.value).startswith(f'{tmp_path / "line.yaml"}: ')
    assert '\n' not in str(error.value)


def test_a_file_that_is_not_there(tmp_path: Path):
    with pytest.raises(SettingsError, match=r'line\.yaml: No such file'):
        read_line(tmp_path / 'line.yaml')


def test_a_description_of_a_newer_format_may_have_keys_that_are_not_known(tmp_path: Path):
    newer = {**changed('lanes.lane1.colour', 'blue'), 'format': 2, 'hall': 'north'}
    assert read(tmp_path, newer) == read(tmp_path, content())
    assert read(tmp_path, {**content(), 'format': 1}).discovery == 'hosts'
