# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path
from typing import Any

import pytest
import yaml

from checkweigher_bringup.hosts.description import LayoutError, LineDescription, read_line
from checkweigher_dsp.ros.ports import NODES

REST = ['product', 'segmenter', 'denoise', 'identifier']


def content() -> dict[str, Any]:
    return {
        'hosts': {'hall': '10.75.0.1', 'server': '10.75.0.2'},
        'lanes': {
            'lane1': {'host': 'hall', 'params': 'own.yaml'},
            'lane2': {
                'nodes': {'hall': ['reject', 'driver'], 'server': REST},
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
    assert (part.name, part.nodes) == ('lane2/driver+reject', ('driver', 'reject'))
    (other,) = line.shares('server')
    assert other.nodes == ('product', 'segmenter', 'denoise', 'identifier')
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


def test_clocks_are_compared_where_hosts_share_a_lane_or_run_none(tmp_path: Path):
    described = content()
    described['hosts'] |= {'attic': '10.75.0.3', 'eyes': '10.75.0.4'}
    described['lanes']['lane3'] = {'host': 'attic'}
    line = read(tmp_path, described)
    assert line.compared_with('hall') == {'eyes': '10.75.0.4', 'server': '10.75.0.2'}
    assert [*line.compared_with('attic')] == ['eyes']
    assert [*line.compared_with('eyes')] == ['attic', 'hall', 'server']


def test_a_host_that_is_not_there(tmp_path: Path):
    with pytest.raises(LayoutError, match=r'host attic: .* it has hall, server'):
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
        ('[', 'not a YAML file: line 1'),
        ('hosts: {}\nhosts: {}', 'hosts stands twice'),
        ('- 1', 'not a table of hosts, lanes, discovery'),
        (changed('hosts', None), 'has no hosts'),
        (changed('lanes', {}), 'lanes: not a table with one entry'),
        (changed('hots', {}), "'hots' is none of hosts, lanes, discovery"),
        (changed('hosts.hall', 'hall.local'), "hosts.hall: 'hall.local' is no IP address"),
        (changed('hosts.hall', '10.75.0.2'), 'two have the same address'),
        (changed('discovery', 'everywhere'), "discovery: 'everywhere' is none of hosts, subnet"),
        (changed('lanes.1', {'host': 'hall'}), "lanes: '1' is no name"),
        (changed('lanes.lane1.host', 'attic'), "lanes.lane1.host: 'attic' is none of the hosts"),
        (changed('lanes.lane1.nodes', {}), 'needs host .* or nodes .*, one of them'),
        (changed('lanes.lane1.host', None), 'needs host .* or nodes .*, one of them'),
        (changed('lanes.lane1.params', 3), 'lanes.lane1.params: not a list'),
        (changed('lanes.lane1.params', 'no.yaml'), 'lanes.lane1.params: there is no file'),
        (changed('lanes.lane1.product', 'soup'), 'lanes.lane1.product: .* recipes'),
        (changed('lanes.lane2.nodes.hall', ['driver']), 'lanes.lane2.nodes: no host has reject'),
        (changed('lanes.lane2.nodes.hall', ['drive']), "'drive' is none of driver, product"),
        (
            changed('lanes.lane2.nodes.server', ['driver', *REST]),
            'lanes.lane2.nodes.server: driver stands twice',
        ),
    ],
)
def test_what_cannot_be_used_is_one_line(line: object, message: str, tmp_path: Path):
    with pytest.raises(LayoutError, match=message) as error:
        read(tmp_path, line)
    assert str(error.value).startswith(f'{tmp_path / "line.yaml"}: ')
    assert '\n' not in str(error.value)


def test_a_file_that_is_not_there(tmp_path: Path):
    with pytest.raises(LayoutError, match=r'line\.yaml: No such file'):
        read_line(tmp_path / 'line.yaml')
