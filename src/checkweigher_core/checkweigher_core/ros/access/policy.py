# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Security policy of a line for SROS2: the least rights of each node, from ports and services."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

from checkweigher_core.ros import ports
from checkweigher_core.ros.ports import NODES, Port
from checkweigher_core.ros.services import (
    LIFE_CYCLE_NODES,
    LIFE_CYCLE_SERVICES,
    NODE_SERVICES,
    OF_MACHINE,
    PAGE_WORK,
    PARAMETER_SERVICES,
    REPORTER,
    SERVICES,
    SETTER,
    VERIFIER,
    VERIFY,
)

LINE = 'line'  # the process in which all nodes of a lane may run
PAGE = 'page'
_PORTS = (*ports.ALL, ports.DYNAMIC_SETTING, ports.VERIFICATION_PROGRESS)
_EVERY_NODE = frozenset({'/rosout', '/parameter_events'})
# Topics that observers subscribe to, by node.
_VIEWED: dict[str, tuple[Port, ...]] = {
    'status': (ports.DIAGNOSTICS,),
    'echo': (ports.MASS_ESTIMATE, ports.VERDICT, ports.REFERENCE_MASS),
    'record': ports.RECORDED,
    PAGE: (ports.DIAGNOSTICS,),
    'segmenter': (ports.DIAGNOSTICS,),  # of clocks, where its stamps come from two hosts
    'page_results': (
        ports.LOAD_CELL_INFO, ports.PHOTO_EYES, ports.REFERENCE_MASS, ports.MASS_ESTIMATE,
        ports.VERDICT, ports.STATISTICS, ports.FILLER_FEEDBACK, ports.STOP_REQUEST,
    ),
    'page_signals': (ports.LOAD_CELL_SAMPLES, ports.DENOISED_WINDOW),
    PAGE_WORK: (
        ports.DYNAMIC_SETTING, ports.VERIFICATION_PROGRESS, ports.PERFORMANCE_TEST,
        ports.PRODUCT_IN_USE,
    ),
    VERIFY: tuple(port for port in ports.RECORDED if port is not ports.VERIFICATION),
    REPORTER: (ports.BATCH_RESULT,),
}  # fmt: skip
OBSERVERS, PAGE_VIEWERS = ('status', 'echo', 'record'), ('page_results', 'page_signals')


@dataclass(frozen=True, slots=True)
class Rights:
    """Full names of what a node may do; DDS reads a ``*`` in a name as any characters."""

    publish: frozenset[str] = frozenset()
    subscribe: frozenset[str] = frozenset()
    reply: frozenset[str] = frozenset()
    request: frozenset[str] = frozenset()


def rights(node: str, lane: str = '') -> Rights:
    """Return the rights of a node of this name in the namespace `lane`."""
    space = f'/{lane}' if lane else ''
    own = f'{space}/{node}'
    publish = _EVERY_NODE | _names(space, (port for port in _PORTS if _makes(node, port)))
    reply = {f'{own}/{name}' for name in NODE_SERVICES}
    request = {f'{space}/{each.name}' for each in SERVICES if node in each.callers}
    if node in (*NODES, *OF_MACHINE):
        publish |= {f'{own}/_*'}  # by which a node finds its own participant, at its start
    if node in LIFE_CYCLE_NODES:
        publish |= {f'{own}/transition_event'}
        reply |= {f'{own}/{name}' for name in LIFE_CYCLE_SERVICES}
    reply |= {f'{space}/{each.name}' for each in SERVICES if each.server == node}
    if node == 'product':  # it sets the parameters of a recipe, and reads those of all
        request |= {f'{space}/{n}/{name}' for n in NODES for name in PARAMETER_SERVICES}
    if node == VERIFY:  # the report has their digest; the client of rclpy makes one for each
        request |= {f'{space}/{n}/{name}' for n in NODES for name in PARAMETER_SERVICES}
    if node == PAGE_WORK:
        request |= _of_page_work(space)
    return Rights(publish, _subscribed(node, space), frozenset(reply), frozenset(request))


def _makes(node: str, port: Port) -> bool:
    every = port.maker == 'every node' and node in (*NODES, *OF_MACHINE)
    inputs = port is ports.EXTERNAL_REJECT and node == 'driver'  # what its inputs show
    return every or inputs or port.maker == node


def _subscribed(node: str, space: str) -> frozenset[str]:
    viewed = _VIEWED.get(node, ())
    return _names(space, (port for port in _PORTS if node in port.takers or port in viewed))


def _of_page_work(space: str) -> set[str]:
    states = {f'{n}/{name}' for n in LIFE_CYCLE_NODES for name in ('get_state', 'change_state')}
    parameters = {f'{node}/get_parameters' for node in NODES}
    changed = {
        f'{node}/{SETTER}' for node in (*LIFE_CYCLE_NODES, 'segmenter', 'product', *OF_MACHINE)
    }
    return {f'{space}/{name}' for name in states | parameters | changed}


def _names(space: str, rows: Iterable[Port]) -> frozenset[str]:
    return frozenset(p.name if p.name.startswith('/') else f'{space}/{p.name}' for p in rows)


def enclaves(lanes: Iterable[str]) -> dict[str, list[tuple[str, str]]]:
    """Return the enclaves of some lanes: the nodes of each, as namespace and name.

    Each node of a lane has one, and the process with all six. The page serves all lanes from one
    process, so it has one enclave.
    """
    lanes = list(lanes)
    found: dict[str, list[tuple[str, str]]] = {}
    for lane in lanes:
        space = f'/{lane}' if lane else ''
        for node in (*NODES, *OF_MACHINE, REPORTER):
            found[f'{space}/{node}'] = [(lane, node)]
        found[f'{space}/{VERIFIER}'].append((lane, VERIFY))  # which records in its process
        found[f'{space}/{LINE}'] = [(lane, node) for node in NODES]
        found[f'{space}/observer'] = [(lane, node) for node in OBSERVERS]
    of_lanes = [(lane, node) for lane in lanes for node in (*PAGE_VIEWERS, PAGE_WORK)]
    found[f'/{PAGE}'] = [('', PAGE), *of_lanes]
    return found


def policy(lanes: Iterable[str]) -> str:
    """Return the policy of some lanes as XML, as ``ros2 security generate_artifacts`` takes it."""
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
    its = rights(node, lane)
    for group, kind, names in (
        ('topics', 'publish', its.publish), ('topics', 'subscribe', its.subscribe),
        ('services', 'reply', its.reply), ('services', 'request', its.request),
    ):  # fmt: skip
        _add_names(profile, group, {kind: 'ALLOW'}, names)


def _add_names(
    profile: ElementTree.Element, group: str, rule: Mapping[str, str], names: Iterable[str]
) -> None:
    if not names:
        return
    parent = ElementTree.SubElement(profile, group, dict(rule))
    for name in sorted(names):
        ElementTree.SubElement(parent, group.removesuffix('s')).text = name
