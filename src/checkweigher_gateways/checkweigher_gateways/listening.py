# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the running lanes, in a bounded queue for the thread of a gateway."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import partial
import time
from typing import Any, NamedTuple

from checkweigher_core.health.findings import Finding, conclude, error_if, warn_if
from checkweigher_core.ros import ports
from checkweigher_core.ros.diagnostics import Diagnostics
from checkweigher_core.ros.graph.lanes import running_lanes
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.ports import Port
from checkweigher_core.ros.spinner import Spinner

LIMIT = 10_000  # largest number of waiting records, as many as a fast lane sends in 10 minutes
_LOOK_PERIOD = 0.5  # shortest time in s between two searches for lanes
_STANDSTILL = 10.0  # time in s without a search after which the gateway counts as hung


class Taken(NamedTuple):
    """Record that was received from a port, with the namespace of its lane.

    The namespace is empty for /diagnostics, and for a lane without a namespace.
    """

    lane: str
    port: Port
    record: Any


class _Finder(PortNode):
    """Node that publishes the diagnostics of the gateway, and searches the graph for lanes."""

    def __init__(
        self, name: str, namespace: str, diagnose: Callable[[float], Iterable[Finding]]
    ) -> None:
        super().__init__(name, namespace=f'/{namespace}')
        self.diagnostics = Diagnostics(self, diagnose)

    def start(self) -> None:
        self.diagnostics.start()


class Intake:
    """Subscriptions of a gateway to its lanes, and the queue of records for its thread.

    The ROS thread only appends to the queue. If the queue is full, the oldest record is dropped and
    counted. If `kept` is true, verdicts that were published before the subscription are received as
    well. `namespace` is the namespace of the only lane, or None for all lanes in the ROS graph.
    `findings` returns the findings of the gateway, which are published as diagnostics.

    Attributes
    ----------
    dropped : int
        Number of dropped records.
    spinner : Spinner
        Executor of the nodes.
    nodes : set of str
        Names, without namespaces, of all nodes that the last search has found in the ROS graph.
    """

    def __init__(
        self,
        name: str,
        spinner: Spinner,
        findings: Callable[[float], Iterable[Finding]],
        namespace: str | None = None,
        *,
        kept: bool = False,
    ) -> None:
        self.dropped = 0
        self.nodes: set[str] = set()
        self._name, self.spinner, self._kept = name, spinner, kept
        self._only = namespace
        self._records: deque[Taken] = deque(maxlen=LIMIT)
        self._lanes: set[str] = set()
        self._looked = time.monotonic()
        self._finder = _Finder(
            name, namespace or '', lambda now: [self._finding(now), *findings(now)]
        )
        spinner.add(self._finder)
        # Subscribe to the diagnostics in a separate node. An input of the finder would be connected
        # to the output of the finder within the process, and would not receive other diagnostics.
        board = PortNode(f'{name}_board')
        take = partial(self._take, '', ports.DIAGNOSTICS)
        board.subscribe(ports.DIAGNOSTICS, take, needed=False)
        spinner.add(board)

    def drain(self) -> Iterator[Taken]:
        """Search for new lanes at most twice a second, and yield the waiting records.

        The records are removed from the queue, and yielded in the order in which they arrived.
        """
        now = time.monotonic()
        if now - self._looked > _LOOK_PERIOD:
            self._looked = now
            self._look()
        while self._records:
            yield self._records.popleft()

    def _look(self) -> None:
        self.nodes = set(self._finder.get_node_names())
        found = running_lanes(self._finder) if self._only is None else {self._only}
        for lane in found - self._lanes:
            self._lanes.add(lane)
            node = PortNode(f'{self._name}_lane', namespace=f'/{lane}')
            for port in ports.GATEWAY_RECORDS:
                qos = port.qos if self._kept else port.stage_qos
                node.subscribe(port, partial(self._take, lane, port), qos=qos, needed=False)
            self.spinner.add(node)

    def _take(self, lane: str, port: Port, record: Any) -> None:
        self.dropped += len(self._records) == LIMIT
        self._records.append(Taken(lane, port, record))

    def _finding(self, now: float) -> Finding:
        still = now - self._looked
        return conclude(
            'Lanes',
            ', '.join(f'/{lane}' for lane in sorted(self._lanes)) or 'no lane runs',
            [
                error_if(still > _STANDSTILL, f'has hung for {still:.0f} s', 'restart the gateway'),
                warn_if(
                    self.dropped > 0,
                    f'{self.dropped} records were dropped',
                    'the gateway was too slow; check the processor load',
                ),
            ],
            {'waiting': str(len(self._records)), 'dropped': str(self.dropped)},
        )
