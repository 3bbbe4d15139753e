# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Security policy, compared with the endpoints of a running line in separate processes."""

from pathlib import Path

from graph import wait_for
from processes import parameter_file
import rclpy
from rclpy.node import Node
from running import ROOT, command_line

from checkweigher_bringup.spinning import node_command, running_processes, spinning
from checkweigher_bringup.supervision.running_line import BESIDE
from checkweigher_core.ros import ports
from checkweigher_core.ros.graph.policy import PAGE_WORK, REPORTER, Rights, rights
from checkweigher_core.ros.services import OF_MACHINE

LANE = 'guarded'
RECIPES = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'
# Of the start alone: by it a node finds its own participant.
PASSING = '/_*'
# What a node takes only when it needs it: of clocks, where its stamps come from two hosts.
RARE = {'segmenter': {ports.DIAGNOSTICS.name}}


def endpoints(node: Node, name: str, space: str) -> Rights:
    """Return the endpoints of a node of the graph."""
    asked = (
        node.get_publisher_names_and_types_by_node,
        node.get_subscriber_names_and_types_by_node,
        node.get_service_names_and_types_by_node,
        node.get_client_names_and_types_by_node,
    )
    try:
        found = [{each for each, _ in ask(name, space)} for ask in asked]
    except RuntimeError:  # it is not there yet
        return Rights()
    return Rights(
        *(frozenset(e for e in each if '/_' not in e.replace('/_action/', '/')) for each in found)
    )


def lasting(node: str, lane: str = LANE) -> Rights:
    its = rights(node, lane)
    publish = frozenset(name for name in its.publish if not name.endswith(PASSING))
    return Rights(publish, its.subscribe - RARE.get(node, set()), its.reply, its.request)


def test_each_node_does_what_its_policy_allows_and_all_of_it(tmp_path: Path):
    for name in ('batches', *OF_MACHINE):
        (tmp_path / name).mkdir()
    product = {
        'audit_log': str(tmp_path / 'audit.log'),
        'recipes': str(RECIPES),
        'batch_folder': str(tmp_path / 'batches'),
    }
    # Nothing listens there: the services of the outputs are there all the same.
    inputs = {'inputs': 'modbus', 'modbus_inputs.port': 1, 'modbus_inputs.metal': 5}
    driver = {'outputs': 'modbus', 'modbus.port': 1, **inputs}
    machine = {name: {'folder': str(tmp_path / name)} for name in OF_MACHINE}
    file = parameter_file(tmp_path / 'line.yaml', {'driver': driver, 'product': product, **machine})
    modules = {**ports.NODES, **{name: BESIDE[name] for name in OF_MACHINE}}
    commands = {name: node_command(module, LANE, file) for name, module in modules.items()}
    commands[REPORTER] = node_command('checkweigher_bringup.batch_reporter', LANE)
    with running_processes(commands), spinning() as spinner:
        looker = rclpy.create_node('looker')
        spinner.add(looker)
        for name in commands:
            if name == REPORTER:
                continue
            wait_for(lambda name=name: endpoints(looker, name, f'/{LANE}') == lasting(name))
        wait_for(lambda: endpoints(looker, REPORTER, f'/{LANE}').subscribe != frozenset())
        assert excess(endpoints(looker, REPORTER, f'/{LANE}'), lasting(REPORTER)) == Rights()


def excess(found: Rights, allowed: Rights) -> Rights:
    return Rights(
        found.publish - allowed.publish,
        found.subscribe - allowed.subscribe,
        found.reply - allowed.reply,
        found.request - allowed.request,
    )


def test_who_looks_on_does_no_more_than_its_policy_allows(tmp_path: Path):
    gateways = tmp_path / 'gateways.yaml'
    gateways.write_text('metrics: {port: 0}')
    commands = {
        'run': command_line('run', '--namespace', LANE),
        'page': command_line('page', '--port', 0),
        'status': command_line('status'),
        'gateway': command_line('gateway', 'metrics', '--settings', gateways),
        'echo': command_line('echo', '--namespace', LANE),
        'record': command_line('record', '--namespace', LANE, '--output', tmp_path / 'bag'),
    }
    places = {
        'page': '/', 'status': '/', 'echo': f'/{LANE}', 'record': f'/{LANE}',
        'run': f'/{LANE}', 'page_results': f'/{LANE}', 'gateway_metrics_board': '/',
        'gateway_metrics_lane': f'/{LANE}',
    }  # fmt: skip
    with running_processes(commands), spinning() as spinner:
        looker = rclpy.create_node('looker')
        spinner.add(looker)
        for name, space in places.items():
            allowed = lasting(name, space.strip('/'))
            wait_for(lambda n=name, s=space: endpoints(looker, n, s).subscribe != frozenset())
            found = endpoints(looker, name, space)
            assert excess(found, Rights(allowed.publish, allowed.subscribe, found.reply)) == (
                Rights()
            ), name


def test_the_clients_of_the_page_are_allowed():
    from checkweigher_web.work.services import LaneServices

    with spinning() as spinner:
        work, looker = LaneServices(LANE), rclpy.create_node('looker')
        spinner.add(work, looker)
        wait_for(lambda: bool(endpoints(looker, PAGE_WORK, f'/{LANE}').request))
        wait_for(
            lambda: (
                endpoints(looker, PAGE_WORK, f'/{LANE}').request == rights(PAGE_WORK, LANE).request
            )
        )
