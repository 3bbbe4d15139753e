# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A line with a product node over real DDS, and an operator beside it."""

from array import array
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
import queue
from typing import Any

from checkweigher_msgs.srv import SelectProduct
from graph import call, wait_for
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from running import PATIENCE

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, MassEstimate
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import stamp_from, to_message
from checkweigher_core.ros.outputs import Output
from checkweigher_dsp.nodes.identifier import IdentifierNode
from checkweigher_production.audit_log import Entry, read_log
from checkweigher_production.nodes.product import ProductNode

RECIPES = """
products:
  crisps:
    nominal: 0.150
    tare: 0.004
    lower_limit: TU1
    upper_limit: 0.165
    parameters: {identifier: {estimator: hann}}
  nuts: {nominal: 0.2, lower_limit: 0.19}
  tins: {nominal: 0.1, tare: 0.004, tu1_quota: 0.025, filler: {max_correction: 0.003}}
  tested: {nominal: 0.1, test: {mass: 0.1, limit: 0.0005, passes: 2, every_hours: 8, grace: 0}}
  bars: {nominal: 0.1, length: [0.05, 0.15], speed: [0.5, 1.5]}
  snails: {nominal: 0.1, speed: [0.01, 0.05]}
  half_trained:
    nominal: 0.1
    parameters:
      denoise: {stretch: 2048}
      identifier: {estimator: mean, mean: {gain: [1.0, 1.1]}}
"""
TU1_GROSS = 0.1432 + 0.004
BELT = LoadCell(960.0, 5e5, 1.25e6, -(2**23), 2**23 - 1, 7.2, 0.2)


class Unheard(IdentifierNode):
    """An identifier in whose place the operator publishes estimates."""

    def held_output(self, port: ports.Port, answer: ports.Port | None = None) -> Output:
        return super().held_output(replace(port, name='unheard'), answer)


class Line:
    """Stages and product node on one executor, and an operator beside them.

    The identifier `weighs` a stream of a driver, or the operator has items judged.
    """

    def __init__(
        self,
        spinner: Spinner,
        folder: Path,
        without: str = '',
        needs_product: bool = False,
        weighs: bool = False,
        **parameters: object,
    ) -> None:
        self.spinner = spinner
        self.recipes = folder / 'recipes.yaml'
        self.recipes.write_text(RECIPES, encoding='utf-8')
        self.log = folder / 'audit.log'
        self._identifier = IdentifierNode if weighs else Unheard
        # Without deadlines, for a bag comes faster than its time.
        numbers = str(folder / 'verdicts')  # so that a new reject node judges no item again
        rules = {'needs_product': needs_product, 'numbers': numbers}
        self.for_reject = {'deadlines': False, **rules}
        self.stages = {name: self.make(name) for name in STAGE_NODES if name != without}
        self.operator = Node('operator')
        self.verdicts: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.statistics: list[Any] = []
        self.publishers: dict[str, Any] = {}
        self.judged = 0
        self.listen(ports.VERDICT, self.verdicts.put)
        self.listen(ports.STATISTICS, self.statistics.append)
        self.products: list[Any] = []  # by which items are judged
        self.listen(ports.PRODUCT_IN_USE, self.products.append)
        for node in self.stages.values():
            spinner.add(node)
        self.start_product(**parameters)
        spinner.add(self.operator)

    def start_product(self, **parameters: object) -> None:
        files = {'recipes': str(self.recipes), 'audit_log': str(self.log)}
        self.product = ProductNode({**files, **parameters})
        self.spinner.add(self.product)

    def restart_product(self, **parameters: object) -> None:
        """Destroy the product node, and start another one with these parameters."""
        self.spinner.remove(self.product)
        wait_for(lambda: 'product' not in self.operator.get_node_names())
        self.start_product(**parameters)

    def wait_until_found(self) -> None:
        """Wait until the parameters of all nodes are in the audit log."""
        wait_for(lambda: len(self.entries('found')) == len(STAGE_NODES) + 1)

    def make(self, name: str) -> Any:
        kind = self._identifier if name == 'identifier' else STAGE_NODES[name]
        return kind(self.for_reject if name == 'reject' else None)

    def restart(self, name: str) -> None:
        """Destroy a stage and put another one in its place."""
        self.spinner.remove(self.stages[name])
        # Two nodes of one name in one process and the graph loses the name of the second.
        wait_for(lambda: name not in self.operator.get_node_names())
        self.stages[name] = self.make(name)
        self.spinner.add(self.stages[name])
        self.publishers.clear()

    def listen(self, topic: ports.Port, callback: Callable[[Any], None]) -> None:
        self.operator.create_subscription(topic.type, topic.name, callback, topic.qos)

    def call(self, kind: Any, name: str, /, **request: object) -> Any:
        return call(self.operator, kind, name, **request)

    def select(self, product: str) -> Any:
        return self.call(SelectProduct, 'select_product', product=product)

    def set_limit(self, name: str, value: float) -> Any:
        """Set a parameter of the reject node, and return the result."""
        change = Parameter(name, value=value).to_parameter_msg()
        return self.call(SetParameters, 'reject/set_parameters', parameters=[change]).results[0]

    def wait_for_product(self, name: str) -> None:
        wait_for(lambda: bool(self.products) and self.products[-1].product == name)

    def judge(self, mass: float, length: float = 0.1, reasons: tuple[str, ...] = ()) -> Any:
        """Have an item of a mass pass the eyes and be judged, and return its verdict."""
        self.judged += 1
        begin = (1_700_000_000 + 5 * self.judged) * NANOSECONDS
        t1, t2, t3, t4 = (begin + tenths * NANOSECONDS // 10 for tenths in range(4))
        self.publish(ports.LOAD_CELL_INFO, to_message(ports.LOAD_CELL_INFO, BELT, stamp=begin))
        for stamp in (t1, t2, t3, t4):
            eye = Eye.INFEED if stamp in (t1, t2) else Eye.OUTFEED
            edge = EyeEdge(stamp, eye, stamp in (t1, t3))
            self.publish(ports.PHOTO_EYES, to_message(ports.PHOTO_EYES, edge))
        known = {'belt_speed': 1.0, 'line_speed': 1.0, 'product_length': length}
        estimate = MassEstimate(self.judged, t1, t2, t3, reasons, mass, 1e-4, **known)
        self.publish(ports.MASS_ESTIMATE, to_message(ports.MASS_ESTIMATE, estimate))
        while True:
            verdict = self.verdicts.get(timeout=PATIENCE)
            # The segmenter, which gets no samples, has its say of old items to a new reject node.
            if stamp_from(verdict.t1) == t1:
                return verdict

    def publish(self, topic: ports.Port, message: Any) -> None:
        if topic.name not in self.publishers:
            publisher = self.operator.create_publisher(topic.type, topic.name, topic.qos)
            wait_for(lambda: publisher.get_subscription_count() >= 2)
            self.publishers[topic.name] = publisher
        self.publishers[topic.name].publish(message)

    def parameters(self) -> dict[str, dict[str, object]]:
        return {
            name: {
                n: list(p.value) if isinstance(p.value, (array, tuple)) else p.value
                for n, p in node.get_parameters_by_prefix('').items()
            }
            for name, node in self.stages.items()
        }

    def entries(self, *kinds: str) -> list[Entry]:
        found = read_log(self.log)
        assert found.whole
        return [entry for entry in found.entries if entry.kind in kinds]
