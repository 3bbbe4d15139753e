# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Description of a line over several hosts: which lane runs which of its nodes where.

.. code-block:: yaml

    hosts:
      hall: 10.0.0.11        # address
      server: 10.0.0.12
    discovery: hosts         # or subnet, or the name of the host with the discovery server
    lanes:
      lane1:                 # its namespace
        host: hall           # of all nodes
        params: [common.yaml, lane1.yaml]   # beside this file
        recipes: recipes.yaml
        product: crisps_150g
      lane2:
        nodes:
          hall: [driver, reject]
          server: [product, segmenter, denoise, identifier]
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
import ipaddress
from pathlib import Path
import re
from typing import Any

from checkweigher_dsp.ros.ports import NODES
from checkweigher_dsp.yaml_files import read_yaml_as

HOSTS, SUBNET = 'hosts', 'subnet'  # kinds of discovery beside a server
SERVER_PORT = 11811  # of a discovery server, by eProsima
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]{0,63}')


class LayoutError(ValueError):
    """A line description that cannot be used; the message says where and why, in one line."""


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane: where its nodes run, and with which parameters."""

    name: str  # namespace
    nodes: Mapping[str, tuple[str, ...]]  # by host
    params: tuple[Path, ...] = ()
    recipes: Path | None = None
    product: str = ''


@dataclass(frozen=True, slots=True)
class Share:
    """The nodes of a lane that a host runs in one process."""

    lane: str
    nodes: tuple[str, ...]
    params: tuple[Path, ...]
    product: Mapping[str, str]  # parameters of the node product, that win over the files

    @property
    def name(self) -> str:
        """Name of the process."""
        return f'{self.lane}/{"+".join(self.nodes) if len(self.nodes) < len(NODES) else "line"}'


@dataclass(frozen=True, slots=True)
class LineDescription:
    """Hosts by name with their addresses, and lanes."""

    hosts: Mapping[str, str]
    lanes: tuple[Lane, ...]
    discovery: str = HOSTS

    def shares(self, host: str) -> tuple[Share, ...]:
        """Return what a host runs; `LayoutError` if there is no such host."""
        if host not in self.hosts:
            raise LayoutError(
                f'host {host}: not in the line description; it has {_list(self.hosts)}'
            )
        return tuple(
            Share(lane.name, lane.nodes[host], lane.params, _values(lane))
            for lane in self.lanes
            if host in lane.nodes
        )

    def compared_with(self, host: str) -> dict[str, str]:
        """Return the hosts whose clocks are compared with that of a host, with their addresses.

        These share a lane with it. One that runs no lane is there for nodes of somebody's own,
        and compared with all.
        """
        of_lanes = [set(lane.nodes) for lane in self.lanes]
        busy = set().union(*of_lanes)
        shared = set().union(*(hosts for hosts in of_lanes if host in hosts))
        return {
            name: address
            for name, address in sorted(self.hosts.items())
            if name != host and (name in shared or not {name, host} <= busy)
        }

    def environment(self) -> dict[str, str]:
        """Return the environment by which the nodes of all hosts find each other, and no others."""
        if self.discovery == SUBNET:
            return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
        if self.discovery == HOSTS:
            several = len(self.hosts) > 1
            peers = {'ROS_STATIC_PEERS': ';'.join(self.hosts.values())} if several else {}
            return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', **peers}
        # Without SUBNET the participants bind to the loopback device alone.
        server = f'{self.hosts[self.discovery]}:{SERVER_PORT}'
        return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', 'ROS_DISCOVERY_SERVER': server}


def _values(lane: Lane) -> dict[str, str]:
    """Return the parameters of the node product that the description has itself."""
    values = {'recipes': str(lane.recipes or ''), 'product': lane.product}
    return {name: value for name, value in values.items() if value}


def read_line(path: Path) -> LineDescription:
    """Return the description of a line; `LayoutError` if the file cannot be used."""
    content = read_yaml_as(path, LayoutError)
    try:
        return _line(content, path.parent)
    except LayoutError as error:
        raise LayoutError(f'{path}: {error}') from None


def _line(content: Any, folder: Path) -> LineDescription:
    _check_keys('', content, ('hosts', 'lanes'), ('discovery',))
    hosts = {_name('hosts', n): _address(n, a) for n, a in _table('hosts', content['hosts'])}
    if len(set(hosts.values())) < len(hosts):
        raise LayoutError('hosts: two have the same address')
    discovery = content.get('discovery', HOSTS)
    if discovery not in (HOSTS, SUBNET, *hosts):
        raise LayoutError(f'discovery: {discovery!r} is none of {_list((HOSTS, SUBNET, *hosts))}')
    lanes = tuple(
        _lane(name, lane, hosts, folder) for name, lane in _table('lanes', content['lanes'])
    )
    return LineDescription(hosts, lanes, discovery)


def _lane(name: Any, content: Any, hosts: Mapping[str, str], folder: Path) -> Lane:
    _name('lanes', name)
    where = f'lanes.{name}'
    _check_keys(where, content, (), ('host', 'nodes', 'params', 'recipes', 'product'))
    if ('host' in content) == ('nodes' in content):
        raise LayoutError(f'{where}: needs host (of all nodes) or nodes (by host), one of them')
    if 'host' in content:
        nodes = {_host(f'{where}.host', content['host'], hosts): tuple(NODES)}
    else:
        nodes = _nodes(f'{where}.nodes', content['nodes'], hosts)
    params = content.get('params', [])
    params = [params] if isinstance(params, str) else params
    if not isinstance(params, list):
        raise LayoutError(f'{where}.params: not a list of files')
    files = tuple(_file(f'{where}.params', each, folder) for each in params)
    recipes = content.get('recipes')
    recipe_file = None if recipes is None else _file(f'{where}.recipes', recipes, folder)
    product = content.get('product', '')
    if not isinstance(product, str) or (product and recipe_file is None):
        raise LayoutError(f'{where}.product: needs to be a name, and recipes that have it')
    return Lane(name, nodes, files, recipe_file, product)


def _nodes(where: str, content: Any, hosts: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    placed: set[str] = set()
    for host, names in _table(where, content):
        _host(where, host, hosts)
        if not isinstance(names, list) or not names:
            raise LayoutError(f'{where}.{host}: not a list of nodes')
        for name in names:
            if name not in NODES:
                raise LayoutError(f'{where}.{host}: {name!r} is none of {_list(NODES)}')
            if name in placed:
                raise LayoutError(f'{where}.{host}: {name} stands twice')
            placed.add(name)
        found[host] = tuple(name for name in NODES if name in names)
    if missing := [name for name in NODES if name not in placed]:
        raise LayoutError(f'{where}: no host has {_list(missing)}')
    return found


def _check_keys(where: str, content: Any, needed: tuple[str, ...], others: tuple[str, ...]) -> None:
    begin = f'{where}: ' if where else ''
    if not isinstance(content, dict):
        raise LayoutError(f'{begin}not a table of {_list((*needed, *others))}')
    for name in needed:
        if name not in content:
            raise LayoutError(f'{begin}has no {name}')
    for name in content:
        if name not in (*needed, *others):
            raise LayoutError(f'{begin}{name!r} is none of {_list((*needed, *others))}')


def _table(where: str, content: Any) -> Iterator[tuple[Any, Any]]:
    if not isinstance(content, dict) or not content:
        raise LayoutError(f'{where}: not a table with one entry at least')
    yield from content.items()


def _name(where: str, name: Any) -> str:
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise LayoutError(f'{where}: {name!r} is no name: a letter, then letters, digits and _')
    return name


def _address(name: str, address: Any) -> str:
    try:
        if isinstance(address, str):
            return str(ipaddress.ip_address(address))
    except ValueError:
        pass
    raise LayoutError(f'hosts.{name}: {address!r} is no IP address')


def _host(where: str, name: Any, hosts: Mapping[str, str]) -> str:
    if not isinstance(name, str) or name not in hosts:
        raise LayoutError(f'{where}: {name!r} is none of the hosts {_list(hosts)}')
    return name


def _file(where: str, name: Any, folder: Path) -> Path:
    if not isinstance(name, str) or not name:
        raise LayoutError(f'{where}: {name!r} is not a file')
    path = (folder / name).absolute()
    if not path.is_file():
        raise LayoutError(f'{where}: there is no file {path}')
    return path


def _list(names: Any) -> str:
    return ', '.join(names)
