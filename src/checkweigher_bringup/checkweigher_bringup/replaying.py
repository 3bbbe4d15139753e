# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Replay of a bag by the graph, with all nodes in this process or one process per node."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import fields
import queue
import time
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node

from checkweigher_bringup.errors import LineError, UserError
from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.spinning import (
    Process,
    Spinner,
    memory_file,
    node_command,
    running_processes,
    spinning,
    write_parameter_file,
)
from checkweigher_core.records import StreamState, StreamStatus
from checkweigher_core.ros import ports
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.pipeline.line import LineParameters, Weighing

_PATIENCE = 30.0  # time in s without a message after which a replay at the rate 0 fails
_CHECK_PERIOD = 0.2  # s
_FAREWELL = 1.0  # maximum time in s to wait until recorders have received the last messages
_DISCOVERY_TIME = 1.0  # time in s to wait for the discovery of a driver that already runs


class Collector(ResultListener):
    """Node that collects the results of a graph until every item has its verdict.

    The replay fails if neither a verdict with its estimate nor a status of the segmenter arrives
    for `patience` s. If `waits` is True, because the driver waits for subscribers, the time
    `patience` begins when the segmenter has processed the first sample. `failure` is the error of a
    replay that has failed, or None.
    """

    def __init__(self, patience: float, *, waits: bool = False) -> None:
        super().__init__('replay')
        self.failure: UserError | None = None
        self._patience = patience
        self._waits = waits
        self._expected: int | None = None
        self._samples = 0  # number of samples that the segmenter has processed
        self.listen(ports.SEGMENTER_STATUS, self._on_segmenter)
        self.listen(ports.DRIVER_STATUS, self._on_driver)

    @property
    def finished(self) -> bool:
        """True if every item has its verdict or the replay has failed."""
        return self.failure is not None or self._expected == self.pairs

    def _on_segmenter(self, status: StreamStatus) -> None:
        self.heard = time.monotonic()
        self._samples = status.samples
        self._waits &= self._samples == 0
        if status.state is StreamState.FINISHED:
            self._expected = status.items

    def _on_driver(self, status: StreamStatus) -> None:
        if status.state is StreamState.FAILED:
            self.failure = LineError(status.text)

    def check(self) -> None:
        """Set `failure` if a second driver runs, or if the graph was silent for `patience` s."""
        if self.count_drivers() > 1:
            self.failure = self.conflict()
        elif not self._waits and time.monotonic() - self.heard > self._patience:
            expected = '' if self._expected is None else f' of {self._expected}'
            self.failure = LineError(
                f'the graph has been silent for {self._patience:.0f} s, after {self.pairs}'
                f'{expected} verdicts and {self._samples} samples'
            )

    def conflict(self) -> UserError:
        """Return the error for a second driver in the same lane."""
        name = self.resolve_topic_name(ports.LOAD_CELL_SAMPLES.name)
        return UserError(
            f'something else publishes {name} in this ROS domain; stop it, or choose another '
            '--namespace or ROS_DOMAIN_ID'
        )


def replay(
    driver: Mapping[str, Any], parameters: LineParameters, namespace: str, *, processes: bool
) -> Iterator[Weighing]:
    """Run the graph on a bag, and yield each item when it has its verdict.

    `driver` contains the parameters of the node `driver`, such as the path of the bag, and
    `parameters` contains those of the other nodes. With `processes`, each node has its own process.
    Raises `UserError` if another driver uses the same topics, and `LineError` if the driver fails,
    a node ends early, or the graph is silent for too long before each item has its verdict.
    """
    values = {each.name: getattr(parameters, each.name).as_mapping() for each in fields(parameters)}
    # With deadlines, the results on a slow machine could differ from those of the command `weigh`.
    values['reject']['deadlines'] = False
    # A replay starts without learned parameters, because the bag does not contain them.
    values['identifier']['learning.record'] = '-'
    values['driver'] = dict(driver)
    with spinning(namespace) as spinner, ExitStack() as stack:
        # The segmenter publishes a status for each 0.2 s of signal. At a low replay rate, these
        # statuses are further apart, so the patience is longer.
        patience = _PATIENCE + (1 / driver['rate'] if driver['rate'] > 0 else 0)
        collector = Collector(patience, waits=driver['listeners'] > 0)
        time.sleep(_DISCOVERY_TIME)
        if collector.count_drivers() > 0:
            conflict = collector.conflict()
            collector.destroy_node()
            raise conflict
        children: list[Process] = []
        nodes: list[Node] = [collector]
        if processes:
            file = stack.enter_context(memory_file())
            write_parameter_file(file, values)
            commands = {
                name: node_command(ports.NODES[name], namespace, file)
                for name in ('driver', *ports.STAGES)
            }
            children += stack.enter_context(running_processes(commands)).values()
        else:
            nodes += [make(values[name]) for name, make in reversed(STAGE_NODES.items())]
            nodes.append(DriverNode(values['driver']))
        spinner.add(*nodes)
        yield from _results(collector, children, spinner)
        if collector.failure is not None:
            raise collector.failure
        _wait_until_taken(nodes)


def _results(
    collector: Collector, children: Sequence[Process], spinner: Spinner
) -> Iterator[Weighing]:
    while True:
        # Read `finished` before the queue, because all results are in the queue when `finished` is
        # true.
        finished = collector.finished
        with suppress(queue.Empty):
            while True:
                yield collector.weighings.get(timeout=0 if finished else _CHECK_PERIOD)
        if finished:
            return
        collector.check()
        if not spinner.alive:
            collector.failure = LineError('the graph has ended early; its error is printed above')
        for child in children:
            if child.poll() is not None:
                text = f'a node ended with status {child.returncode}: {child.args!r}'
                collector.failure = LineError(text)


def _wait_until_taken(nodes: Sequence[Node]) -> None:
    """Wait until the subscribers have acknowledged all messages, but at most 1 s in all.

    A node that ends drops its messages that are not acknowledged.
    """
    end = time.monotonic() + _FAREWELL
    for node in nodes:
        for publisher in node.publishers:
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
