# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes in one ROS domain, each with its own process and namespace, and without cross-talk."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from checkweigher_msgs.msg import StopRequest
from checkweigher_msgs.srv import NewBatch, SelectProduct
from graph import call, heard, wait_for
from lines import weigh_all
from processes import LINE, parameter_file
import pytest
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from running import PATIENCE
from std_srvs.srv import Trigger

from checkweigher_bringup.spinning import node_command, running_processes, spinning
from checkweigher_core.records import Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_record
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.audit_log import read_log
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate

# Of each lane, with its bags: one has no namespace, and one begins with the name of another.
MASSES = {'': 0.1, 'lane1': 0.15, 'lane11': 0.2}
CHANGED = 'lane1'
# All are UNDER. 30 m are 20 s for a machine that is busy with something else.
REJECT = {'lower_limit': 0.3, 'max_rejects_in_a_row': 2, 'rejector_distance': 30.0}
RECIPES = """
products:
  crisps: {nominal: 0.14, upper_limit: 0.4, parameters: {identifier: {estimator: hann}}}
"""


def simulator(mass: float) -> dict[str, object]:
    return {
        'speed': 1.5,
        'masses': [mass],
        'lead_in': 1.0,
        'seed': round(1000 * mass),
        'start_time': 1_700_000_000,
        'samples_per_block': 48,  # 50 ms: three lines share what the machine has
    }


class Lane:
    """Operator of a lane."""

    def __init__(self, namespace: str, folder: Path) -> None:
        self.mass = MASSES[namespace]
        self.log = folder / f'audit_{namespace}.log'
        recipes = folder / f'recipes_{namespace}.yaml'
        recipes.write_text(RECIPES, encoding='utf-8')
        source = {f'simulator.{name}': value for name, value in simulator(self.mass).items()}
        self.file = parameter_file(
            folder / f'parameters_{namespace}.yaml',
            {
                'driver': {'simulator.count': 0, **source},
                'reject': REJECT,
                # Without a product a line with recipes accepts nothing, by no limits.
                'product': {
                    'recipes': str(recipes) if namespace == CHANGED else '',
                    'audit_log': str(self.log),
                },
            },
        )
        self.command = node_command(LINE, namespace, self.file)
        self.node = Node('operator', namespace=namespace)
        self.verdicts: list[Verdict] = []
        self.statistics: list[tuple[str, str]] = []
        self.stops: list[int] = []
        self._listen(ports.VERDICT, lambda m: self.verdicts.append(to_record(ports.VERDICT, m)))
        self._listen(ports.STATISTICS, lambda m: self.statistics.append((m.product, m.batch)))
        self._listen(ports.STOP_REQUEST, lambda m: self.stops.append(m.state))

    def _listen(self, topic: ports.Port, callback: Callable[[Any], None]) -> None:
        self.node.create_subscription(topic.type, topic.name, callback, topic.qos)

    def call(self, kind: Any, name: str, **request: object) -> Any:
        return call(self.node, kind, name, **request)

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of all nodes of the lane."""
        values = {}
        for node in ports.NODES:
            names = self.call(ListParameters, f'{node}/list_parameters').result.names
            answer = self.call(GetParameters, f'{node}/get_parameters', names=names)
            values[node] = dict(zip(names, answer.values, strict=True))
        return values

    def wait_for_items(self, more: int) -> None:
        count = len(self.verdicts) + more
        wait_for(lambda: len(self.verdicts) >= count)

    def offline(self, count: int) -> list[Verdict]:
        """Return the first verdicts of the lane, computed offline."""
        parameters = SimulationParameters.from_mapping({**simulator(self.mass), 'count': count + 1})
        weighings = weigh_all(simulate(parameters), LineParameters.from_file(self.file))
        return [weighing.verdict for weighing in islice(weighings, count)]


@pytest.fixture
def lanes(tmp_path: Path) -> Iterator[dict[str, Lane]]:
    with spinning() as spinner:
        found = {namespace: Lane(namespace, tmp_path) for namespace in MASSES}
        for lane in found.values():
            spinner.add(lane.node)
        with running_processes({namespace: lane.command for namespace, lane in found.items()}):
            yield found


def change_all(lane: Lane) -> None:
    """Change everything in a lane that an operator can change."""
    answer = lane.call(SelectProduct, 'select_product', product='crisps')
    assert answer.success, answer.message
    assert lane.call(NewBatch, 'new_batch', batch='monday').success
    limit = Parameter('verdict_margin', value=0.06).to_parameter_msg()
    (set_,) = lane.call(SetParameters, 'reject/set_parameters', parameters=[limit]).results
    assert set_.successful, set_.reason
    zeroed = lane.call(Trigger, 'zero')
    assert zeroed.success, zeroed.message
    assert lane.call(Trigger, 'reset_stop_request').success


def test_what_is_done_to_one_lane_touches_no_other(lanes: dict[str, Lane]):
    told = heard(lanes[CHANGED].node, ports.DIAGNOSTICS, latched=True)
    for lane in lanes.values():
        wait_for(lambda lane=lane: lane.stops[-1:] == [StopRequest.STOP] and len(lane.verdicts) > 2)
    changed = lanes.pop(CHANGED)
    before = {namespace: lane.parameters() for namespace, lane in lanes.items()}
    stops = {namespace: list(lane.stops) for namespace, lane in lanes.items()}
    change_all(changed)
    wait_for(lambda: StopRequest.RUN in changed.stops[-2:])
    changed.wait_for_items(3)
    for lane in lanes.values():
        lane.wait_for_items(3)

    assert changed.verdicts[-1].lower_limit == -float('inf')
    assert changed.statistics[-1] == ('crisps', 'monday')
    first, *rest = changed.offline(len(changed.verdicts))
    assert changed.verdicts[0].mass == first.mass
    assert changed.verdicts[-1].mass != rest[-1].mass
    for namespace, lane in lanes.items():
        verdicts = list(lane.verdicts)
        assert [verdict.mass for verdict in verdicts] == pytest.approx(
            [lane.mass] * len(verdicts), rel=0.03
        )
        assert verdicts == lane.offline(len(verdicts))
        assert lane.parameters() == before[namespace]
        assert set(lane.statistics) == {('', '')}
        assert lane.stops == stops[namespace]
    # All say how they are on one topic, each under the name of its lane.
    named: set[str] = set()
    while not named >= {f'{name}/{node}'.lstrip('/') for name in MASSES for node in ports.NODES}:
        named |= {status.name for status in told.get(timeout=PATIENCE)[1].status}
    wait_for(lambda: any(e.kind == 'parameter' for e in read_log(changed.log).entries))
    kinds = {entry.kind for entry in read_log(changed.log).entries}
    assert kinds >= {'found', 'calibration', 'recipe', 'selection', 'parameter', 'batch'}
    for namespace, lane in {**lanes, CHANGED: changed}.items():
        path = f'/{namespace}'.rstrip('/')
        entries = read_log(lane.log).entries
        assert {entry.source for entry in entries} == {f'{path}/product'}
        touched = {e.subject.split('.')[0] for e in entries if e.kind in ('found', 'parameter')}
        assert touched <= {f'{path}/{node}' for node in ports.NODES}
        if lane is not changed:
            kinds = {entry.kind for entry in entries} - {'alarm'}  # of a busy machine
            assert kinds - {'clock'} == {'log', 'software', 'found', 'calibration', 'run'}
