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
          hall: [driver, segmenter, reject]
          server: [product, denoise, identifier]
"""

from collections.abc import Mapping
from dataclasses import dataclass
import ipaddress
from pathlib import Path
import re
from typing import Any

from checkweigher_core.parameters import SettingsError, parameter
from checkweigher_core.ros.ports import NODES
from checkweigher_core.settings_files import Settings, settings_of
from checkweigher_core.yaml_files import opened

# Items are timed by the clock of one host, and announced and judged although the network is down.
AT_MACHINE = ('driver', 'segmenter', 'reject')
HOSTS, SUBNET = 'hosts', 'subnet'  # kinds of discovery beside a server
SERVER_PORT = 11811  # of a discovery server, by eProsima
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]{0,63}')


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
        """Return what a host runs; `SettingsError` if there is no such host."""
        if host not in self.hosts:
            raise SettingsError(
                f'host {host}: not in the line description; it has {_list(self.hosts)}'
            )
        return tuple(
            Share(lane.name, lane.nodes[host], lane.params, _values(lane))
            for lane in self.lanes
            if host in lane.nodes
        )

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


@dataclass(frozen=True)
class _LaneEntry(Settings):
    """A lane as it is described: the host of all nodes, or the nodes of each host."""

    name: str = parameter(text='namespace')
    host: str = parameter('', 'host of all nodes')
    nodes: Mapping[str, tuple[str, ...]] = parameter(None, 'nodes by host')
    params: tuple[str, ...] = parameter((), 'parameter files, the last one wins')
    recipes: str = parameter('', 'recipe file')
    product: str = parameter('', 'product at the start, of the recipes')

    @classmethod
    def prepared(cls, content: Any) -> Any:
        """Return the table with a list of files where one is named alone."""
        params = content.get('params') if isinstance(content, dict) else None
        return {**content, 'params': [params]} if isinstance(params, str) else content

    def __post_init__(self) -> None:
        _check_name(self.name)
        if bool(self.host) == (self.nodes is not None):
            raise SettingsError('needs host (of all nodes) or nodes (by host), one of them')
        if self.product and not self.recipes:
            raise SettingsError('needs recipes that have it', 'product')
        placed = [name for names in (self.nodes or {}).values() for name in names]
        for host, names in (self.nodes or {}).items():
            if not names:
                raise SettingsError('names no node', 'nodes', host)
            for name in names:
                if name not in NODES:
                    raise SettingsError(f'{name!r} is none of {_list(NODES)}', 'nodes', host)
                if placed.count(name) > 1:
                    raise SettingsError(f'{name} is there twice', 'nodes', host)
        if self.nodes is not None and (missing := [name for name in NODES if name not in placed]):
            raise SettingsError(f'no host has {_list(missing)}', 'nodes')
        shares = [set(names) for names in (self.nodes or {}).values()]
        if shares and not any(share.issuperset(AT_MACHINE) for share in shares):
            text = f'{_list(AT_MACHINE)} are on several hosts; put them on the one at the machine'
            raise SettingsError(text, 'nodes')

    def lane(self, hosts: Mapping[str, str], folder: Path) -> Lane:
        """Return the lane; its files are beside the description."""
        own = self.nodes or {self.host: tuple(NODES)}
        for host in own:
            if host not in hosts:
                place = ('nodes', host) if self.nodes else ('host',)
                raise SettingsError(
                    f'{host!r} is none of the hosts {_list(hosts)}', 'lanes', self.name, *place
                )
        nodes = {
            host: tuple(name for name in NODES if name in names) for host, names in own.items()
        }
        files = tuple(_file(folder / each, 'lanes', self.name, 'params') for each in self.params)
        recipes = (
            _file(folder / self.recipes, 'lanes', self.name, 'recipes') if self.recipes else None
        )
        return Lane(self.name, nodes, files, recipes, self.product)


@dataclass(frozen=True)
class LineFile(Settings):
    """A line as it is described."""

    hosts: Mapping[str, str] = parameter(text='addresses by the names of the hosts')
    lanes: Mapping[str, _LaneEntry] = parameter(text='lanes by their namespaces')
    discovery: str = parameter(HOSTS, 'hosts, subnet, or the host of the discovery server')

    def __post_init__(self) -> None:
        for name, address in self.hosts.items():
            _check_name(name, 'hosts', name)
            try:
                ipaddress.ip_address(address)
            except ValueError:
                raise SettingsError(f'{address!r} is no IP address', 'hosts', name) from None
        if len({ipaddress.ip_address(each) for each in self.hosts.values()}) < len(self.hosts):
            raise SettingsError('two have the same address', 'hosts')
        if self.discovery not in (HOSTS, SUBNET, *self.hosts):
            known = _list((HOSTS, SUBNET, *self.hosts))
            raise SettingsError(f'{self.discovery!r} is none of {known}', 'discovery')


def read_line(path: Path) -> LineDescription:
    """Return the description of a line; `SettingsError` if the file cannot be used."""
    with opened(path) as content:
        file = settings_of(LineFile, content)
        hosts = {name: str(ipaddress.ip_address(each)) for name, each in file.hosts.items()}
        lanes = tuple(each.lane(hosts, path.parent) for each in file.lanes.values())
    return LineDescription(hosts, lanes, file.discovery)


def _check_name(name: str, *place: object) -> None:
    if not _NAME.fullmatch(name):
        text = f'{name!r} is no name: a letter, then letters, digits and _'
        raise SettingsError(text, *place)


def _file(path: Path, *place: object) -> Path:
    if not path.is_file():
        raise SettingsError(f'there is no file {path.absolute()}', *place)
    return path.absolute()


def _list(names: Any) -> str:
    return ', '.join(names)
