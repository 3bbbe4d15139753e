# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Description of a line on several hosts: the nodes of each lane that each host runs.

Examples
--------
Description of two lanes on two hosts:

.. code-block:: yaml

    hosts:
      hall: 10.0.0.11        # address of the host
      server: 10.0.0.12
    discovery: hosts         # or subnet, or the name of the host with the discovery server
    lanes:
      lane1:                 # namespace of the lane
        host: hall           # host of all nodes
        params: [common.yaml, lane1.yaml]   # paths from the folder of this file
        recipes: recipes.yaml
        product: crisps_150g
      lane2:
        nodes:
          hall: [driver, segmenter, reject]
          server: [product, denoise, identifier]
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import ipaddress
from pathlib import Path
import re
from typing import Any

from checkweigher_core.parameters import SettingsError, parameter
from checkweigher_core.ros.ports import NODES
from checkweigher_core.settings_files import Settings, settings_of
from checkweigher_core.yaml_files import opened

# Nodes that must run on the same host. One clock must stamp the samples and time the verdicts. In
# addition, the verdicts must reach the outputs even if the network is down.
AT_MACHINE = ('driver', 'segmenter', 'reject')
HOSTS, SUBNET = 'hosts', 'subnet'  # kinds of discovery without a discovery server
SERVER_PORT = 11811  # default port of the discovery server of Fast DDS
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]{0,63}')


@dataclass(frozen=True, slots=True)
class Share:
    """Nodes of a lane that a host runs in one process."""

    lane: str  # namespace of the lane
    nodes: tuple[str, ...]
    params: tuple[Path, ...]
    product: Mapping[str, str]  # parameters of the node `product`, which override `params`

    @property
    def parameters(self) -> dict[str, Mapping[str, object]]:
        """Parameters by node and name.

        With recipes, each item gets the decision FAULT until a product is selected.
        """
        needs = {'needs_product': True} if 'recipes' in self.product else {}
        return {'product': self.product, 'reject': needs}

    @property
    def name(self) -> str:
        """Name of the process."""
        return f'{self.lane}/{"+".join(self.nodes) if len(self.nodes) < len(NODES) else "line"}'


@dataclass(frozen=True, slots=True)
class LineDescription:
    """Addresses of the hosts by name, the shares of each lane by host, and the kind of discovery.

    `discovery` is `HOSTS`, `SUBNET`, or the name of the host with the discovery server.
    """

    hosts: Mapping[str, str]
    lanes: tuple[Mapping[str, Share], ...]
    discovery: str = HOSTS

    def shares(self, host: str) -> tuple[Share, ...]:
        """Return the shares of a host, or raise `SettingsError` if the host is unknown."""
        if host not in self.hosts:
            raise SettingsError(
                f'host {host}: not in the line description; it has {", ".join(self.hosts)}'
            )
        return tuple(lane[host] for lane in self.lanes if host in lane)

    def environment(self) -> dict[str, str]:
        """Return the environment variables for the discovery of the nodes."""
        if self.discovery == SUBNET:
            return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
        if self.discovery == HOSTS:
            several = len(self.hosts) > 1
            peers = {'ROS_STATIC_PEERS': ';'.join(self.hosts.values())} if several else {}
            return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', **peers}
        # Without SUBNET, the nodes would use only the loopback interface.
        server = f'{self.hosts[self.discovery]}:{SERVER_PORT}'
        return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', 'ROS_DISCOVERY_SERVER': server}


@dataclass(frozen=True)
class _LaneEntry(Settings):
    """Entry of a lane, which names either the host of all nodes or the nodes of each host.

    Raises `SettingsError` if the name of the lane is not valid, if not exactly one of `host` and
    `nodes` is given, or if a product is given without recipes. Also raises the exceptions of
    `_check_nodes`.
    """

    name: str = parameter(text='namespace')
    host: str = parameter('', 'host of all nodes')
    nodes: Mapping[str, tuple[str, ...]] = parameter(None, 'nodes by host')
    params: tuple[str, ...] = parameter((), 'parameter files; later files override earlier files')
    recipes: str = parameter('', 'recipe file')
    product: str = parameter('', 'product of the recipe file that is selected at the start')

    @classmethod
    def prepared(cls, content: Any) -> Any:
        """Return the content of the entry, in which a single file in `params` becomes a list."""
        params = content.get('params') if isinstance(content, dict) else None
        return {**content, 'params': [params]} if isinstance(params, str) else content

    def __post_init__(self) -> None:
        _check_name(self.name)
        if bool(self.host) == (self.nodes is not None):
            raise SettingsError('must have either host (of all nodes) or nodes (by host)')
        if self.product and not self.recipes:
            raise SettingsError('needs recipes that contain the product', 'product')
        if self.nodes is not None:
            _check_nodes(self.nodes)

    def shares(self, hosts: Mapping[str, str], folder: Path) -> dict[str, Share]:
        """Return the shares of the hosts by host name.

        `hosts` contains the addresses by name. Paths in the entry are relative to `folder`. Raises
        `SettingsError` if a host is unknown or a file does not exist.
        """
        nodes = self.nodes or {self.host: tuple(NODES)}
        for host in nodes:
            if host not in hosts:
                place = ('nodes', host) if self.nodes else ('host',)
                text = f'{host!r} is not one of the hosts {", ".join(hosts)}'
                raise SettingsError(text, 'lanes', self.name, *place)
        params = tuple(_file(folder / each, 'lanes', self.name, 'params') for each in self.params)
        product = {'product': self.product} if self.product else {}
        if self.recipes:
            product['recipes'] = str(_file(folder / self.recipes, 'lanes', self.name, 'recipes'))
        return {
            host: Share(self.name, tuple(each for each in NODES if each in names), params, product)
            for host, names in nodes.items()
        }


def _check_share(host: str, names: Sequence[str], placed: Sequence[str]) -> None:
    """Raise `SettingsError` if a host has no node, an unknown node, or a node that is repeated.

    `names` contains the node names of the host, and `placed` those of all hosts of the lane. A name
    that two hosts list, or one host lists twice, is repeated in `placed`.
    """
    if not names:
        raise SettingsError('lists no node', 'nodes', host)
    for name in names:
        if name not in NODES:
            raise SettingsError(f'{name!r} is not one of {", ".join(NODES)}', 'nodes', host)
        if placed.count(name) > 1:
            raise SettingsError(f'{name} is listed twice', 'nodes', host)


def _check_nodes(nodes: Mapping[str, tuple[str, ...]]) -> None:
    """Raise `SettingsError` unless each node has exactly one host.

    `nodes` contains the node names by host. The nodes `AT_MACHINE` must have the same host. Each
    host must have a node.
    """
    placed = [name for names in nodes.values() for name in names]
    for host, names in nodes.items():
        _check_share(host, names, placed)
    if missing := [name for name in NODES if name not in placed]:
        raise SettingsError(f'no host runs {", ".join(missing)}', 'nodes')
    if not any({*names}.issuperset(AT_MACHINE) for names in nodes.values()):
        text = f'{", ".join(AT_MACHINE)} are on several hosts; put all on the host at the machine'
        raise SettingsError(text, 'nodes')


@dataclass(frozen=True)
class LineFile(Settings):
    """Content of the file that describes a line.

    Raises `SettingsError` if the name or the address of a host is not valid, if two hosts have the
    same address, or if `discovery` is unknown.
    """

    hosts: Mapping[str, str] = parameter(text='addresses of the hosts by name')
    lanes: Mapping[str, _LaneEntry] = parameter(text='lanes by namespace')
    discovery: str = parameter(HOSTS, 'hosts, subnet, or the host with the discovery server')

    def __post_init__(self) -> None:
        names: dict[object, str] = {}  # host names by address
        for name, address in self.hosts.items():
            _check_name(name, 'hosts', name)
            try:
                other = names.setdefault(ipaddress.ip_address(address), name)
            except ValueError:
                raise SettingsError(f'{address!r} is not an IP address', 'hosts', name) from None
            if other != name:
                raise SettingsError(f'{other} and {name} have the same address {address}', 'hosts')
        if self.discovery not in (HOSTS, SUBNET, *self.hosts):
            known = ', '.join((HOSTS, SUBNET, *self.hosts))
            raise SettingsError(f'{self.discovery!r} is not one of {known}', 'discovery')


def read_line(path: Path) -> LineDescription:
    """Return the description of a line.

    Raises `SettingsError` if the file `path`, or a file that it names, cannot be used.
    """
    with opened(path) as content:
        file = settings_of(LineFile, content)
        hosts = {name: str(ipaddress.ip_address(each)) for name, each in file.hosts.items()}
        lanes = tuple(each.shares(hosts, path.parent) for each in file.lanes.values())
    return LineDescription(hosts, lanes, file.discovery)


def _check_name(name: str, *place: object) -> None:
    if not _NAME.fullmatch(name):
        text = f'{name!r} must begin with a letter, and contain at most 64 letters, digits and _'
        raise SettingsError(text, *place)


def _file(path: Path, *place: object) -> Path:
    if not path.is_file():
        raise SettingsError(f'there is no file {path.absolute()}', *place)
    return path.absolute()
