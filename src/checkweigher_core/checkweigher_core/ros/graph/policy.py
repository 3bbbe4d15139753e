# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""SROS2 security policy of a line, with the enclaves and the minimal rights of each node."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from itertools import product
import os
from xml.etree import ElementTree

from checkweigher_core.ros import ports, services
from checkweigher_core.ros.ports import NODES, Port
from checkweigher_core.ros.services import (
    GATEWAY_WORK,
    GATEWAYS,
    OF_MACHINE,
    PAGE_WORK,
    REPORTER,
    TECHNICIAN,
    VERIFIER,
    VERIFY,
)

LINE = 'line'  # enclave of a process with all nodes of a lane
RUN = 'run'  # enclave of the command that starts and monitors a line
OBSERVER = 'observer'  # enclave of commands that only subscribe
PAGE = 'page'  # enclave of the page
_PORTS = (*ports.ALL, ports.DYNAMIC_SETTING, ports.VERIFICATION_PROGRESS)
_EVERY_NODE = frozenset({'/rosout', '/parameter_events'})
# Further topics to which a node subscribes, although their ports do not list this node.
_VIEWED: dict[str, tuple[Port, ...]] = {
    'status': (ports.DIAGNOSTICS,),
    'echo': (ports.MASS_ESTIMATE, ports.VERDICT, ports.REFERENCE_MASS),
    'record': ports.RECORDED,
    RUN: (ports.DIAGNOSTICS, ports.MASS_ESTIMATE, ports.VERDICT, ports.REFERENCE_MASS),
    PAGE: (ports.DIAGNOSTICS,),
    'page_results': ports.PAGE_RESULTS,
    'page_signals': ports.PAGE_SIGNALS,
    PAGE_WORK: (
        ports.DYNAMIC_SETTING,
        ports.VERIFICATION_PROGRESS,
        ports.PERFORMANCE_TEST,
        ports.PRODUCT_IN_USE,
    ),
    VERIFY: tuple(port for port in ports.RECORDED if port is not ports.VERIFICATION),
    REPORTER: (ports.BATCH_RESULT,),
    **{f'{name}_board': (ports.DIAGNOSTICS,) for name in GATEWAYS},
    **{f'{name}_lane': ports.GATEWAY_RECORDS for name in GATEWAYS},
}
OBSERVERS, PAGE_VIEWERS = ('status', 'echo', 'record'), ('page_results', 'page_signals')


def _of(nodes: Iterable[str], names: Iterable[str]) -> set[str]:
    return {f'{node}/{name}' for node, name in product(nodes, names)}


# Services of rclpy that a node calls at other nodes, by the name of the calling node.
_CALLED = {
    'product': _of(NODES, services.PARAMETER_SERVICES),  # product sets the parameters of a recipe
    VERIFY: _of(NODES, services.PARAMETER_SERVICES),  # verify reports the parameters
    PAGE_WORK: _of(services.LIFE_CYCLE_NODES, ('get_state', 'change_state'))
    | _of(NODES, ('get_parameters',))
    | _of((*services.LIFE_CYCLE_NODES, 'segmenter', 'product', *OF_MACHINE), (services.SETTER,)),
}


@dataclass(frozen=True, slots=True)
class Rights:
    """Rights of a node as full names of topics and services.

    A ``*`` in a name stands for any characters.
    """

    publish: frozenset[str] = frozenset()
    subscribe: frozenset[str] = frozenset()
    reply: frozenset[str] = frozenset()
    request: frozenset[str] = frozenset()


def rights(node: str, lane: str = '') -> Rights:
    """Return the rights that a node in the namespace `lane` needs."""
    client = PAGE_WORK if node in GATEWAY_WORK else node
    served = [f'{each.name}/_action' for each in services.ACTIONS if each.server == node]
    called = [f'{each.name}/_action' for each in services.ACTIONS if client in each.callers]
    publish = {port.name for port in _PORTS if _makes(node, port)} | _EVERY_NODE
    publish |= _of(served, services.ACTION_TOPICS)
    if node in (*NODES, *OF_MACHINE):
        publish.add(f'{node}/_*')  # temporary publisher of `participant_of`
    if node in services.LIFE_CYCLE_NODES:
        publish.add(f'{node}/transition_event')
    viewed = _VIEWED.get(client, ())
    subscribe = {port.name for port in _PORTS if node in port.takers or port in viewed}
    subscribe |= _of(called, services.ACTION_TOPICS)
    reply = _replies(node) | _of(served, services.ACTION_SERVICES)
    request = _requests(client) | _of(called, services.ACTION_SERVICES)
    return Rights(*(_full(lane, names) for names in (publish, subscribe, reply, request)))


def _replies(node: str) -> set[str]:
    own = {each.name for each in services.SERVICES if each.server == node}
    own |= _of([node], services.NODE_SERVICES)
    return own | _of([node] * (node in services.LIFE_CYCLE_NODES), services.LIFE_CYCLE_SERVICES)


def _requests(client: str) -> set[str]:
    called = {each.name for each in services.SERVICES if client in each.callers}
    return called | _CALLED.get(client, set())


def _makes(node: str, port: Port) -> bool:
    every = port.maker == 'every node' and node in (*NODES, *OF_MACHINE, *GATEWAYS)
    inputs = port is ports.EXTERNAL_REJECT and node == 'driver'  # from its machine inputs
    return every or inputs or port.maker == node


def _full(lane: str, names: Iterable[str]) -> frozenset[str]:
    """Return the full names of topics or services in a lane.

    A name that begins with a slash is already full.
    """
    space = f'/{lane}' if lane else ''
    return frozenset(name if name.startswith('/') else f'{space}/{name}' for name in names)


def enclaves(lanes: Iterable[str]) -> dict[str, list[tuple[str, str]]]:
    """Return the enclaves of some lanes, each with the namespaces and names of its nodes.

    Each node of a lane has an enclave of its own, except the node `verify`, which shares the
    enclave of the node `verifier`, because both run in one process. A process with all nodes of a
    lane has the enclave `LINE`. Each lane also has an enclave for the commands that only subscribe,
    one for the commands that call services and actions, and one for the command `run`. The commands
    `status` and `run --line` belong to no lane, so their enclaves also exist without a lane. The
    page and each gateway serve all lanes from one process, with one enclave each.
    """
    lanes = list(lanes)
    found: dict[str, list[tuple[str, str]]] = {}
    for lane in lanes:
        space = f'/{lane}' if lane else ''
        for node in (*NODES, *OF_MACHINE, REPORTER):
            found[f'{space}/{node}'] = [(lane, node)]
        found[f'{space}/{VERIFIER}'].append((lane, VERIFY))  # runs in the same process
        found[f'{space}/{LINE}'] = [(lane, node) for node in NODES]
        found[f'{space}/{OBSERVER}'] = [(lane, node) for node in OBSERVERS]
        found[f'{space}/{TECHNICIAN}'] = [(lane, TECHNICIAN)]
        found[f'{space}/{RUN}'] = [(lane, RUN)]
    found.setdefault(f'/{OBSERVER}', [('', node) for node in OBSERVERS])
    found.setdefault(f'/{RUN}', [('', RUN)])
    of_lanes = [(lane, node) for lane in lanes for node in (*PAGE_VIEWERS, PAGE_WORK)]
    found[f'/{PAGE}'] = [('', PAGE), *of_lanes]
    for name in GATEWAYS:
        nodes = [f'{name}_lane', *({f'{name}_work'} & {*GATEWAY_WORK})]
        own = [('', name), ('', f'{name}_board')]
        found[f'/{name}'] = [*own, *product(lanes, nodes)]
    return found


def enclave_arguments(lane: str, name: str) -> list[str]:
    """Return the ROS arguments that select an enclave of a lane, empty if security is off."""
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return []
    return ['--enclave', f'/{lane}/{name}' if lane else f'/{name}']


def policy(lanes: Iterable[str]) -> str:
    """Return the policy of some lanes as XML for ``ros2 security generate_artifacts``."""
    root = ElementTree.Element('policy', version='0.2.0')
    parent = ElementTree.SubElement(root, 'enclaves')
    for path, nodes in enclaves(lanes).items():
        enclave = ElementTree.SubElement(parent, 'enclave', path=path)
        profiles = ElementTree.SubElement(enclave, 'profiles')
        for lane, node in nodes:
            _add_profile(profiles, lane, node)
    ElementTree.indent(root)
    header = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return header + ElementTree.tostring(root, encoding='unicode') + '\n'


def _add_profile(profiles: ElementTree.Element, lane: str, node: str) -> None:
    profile = ElementTree.SubElement(profiles, 'profile', ns=f'/{lane}', node=node)
    for right, names in asdict(rights(node, lane)).items():
        what = 'topic' if right in ('publish', 'subscribe') else 'service'
        if names:
            parent = ElementTree.SubElement(profile, f'{what}s', {right: 'ALLOW'})
            for name in sorted(names):
                ElementTree.SubElement(parent, what).text = name
