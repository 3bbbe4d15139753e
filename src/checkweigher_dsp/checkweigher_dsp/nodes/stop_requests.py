# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Output of the stop request, and service that resets it."""

from collections.abc import Callable
import time
from typing import Any

from std_srvs.srv import Trigger

from checkweigher_core.records import (
    MachineConditions,
    PerformanceTest,
    StopRequest,
    StreamState,
    StreamStatus,
)
from checkweigher_core.records.reasons import StopReason
from checkweigher_core.ros import ports
from checkweigher_core.ros.outputs import Input
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_dsp.nodes.strangers import StrangerWatch
from checkweigher_dsp.rejection.monitoring import RejectMonitor

# Period in s of the checks of the publishers and of the time limit of the performance test.
_LOOK_PERIOD = 1.0
_NOT_READY = StopRequest(StopReason.NOT_READY, 0)


class StopRequests:
    """Output of the stop request of a monitor, and the service that resets the request.

    While `active` is false, the node requests a stop. `driver` is the input for the driver status.
    The function `update` is called after each check of the reasons for a stop, and must call
    `show`. The function `shown` is called after each published change of the request, and by
    `begin`.
    """

    def __init__(
        self,
        node: StageNode[Any],
        monitor: RejectMonitor,
        driver: Input,
        update: Callable[[], None],
        shown: Callable[[], None],
    ) -> None:
        self.active = False
        self.output = node.output(ports.STOP_REQUEST)
        self.strangers = StrangerWatch(node)
        self._node, self._monitor, self._driver = node, monitor, driver
        self._update, self._on_shown = update, shown
        self._shown: StopRequest | None = None
        self._conditions = node.subscribe(ports.MACHINE_CONDITIONS, self._on_conditions)
        self._tests = node.subscribe(ports.PERFORMANCE_TEST, self._on_test)
        node.create_service(Trigger, ports.RESET_STOP_REQUEST, self._reset)
        node.create_timer(_LOOK_PERIOD, self._look)

    @property
    def request(self) -> StopRequest | None:
        """Stop request of the node, or None if no stop is requested."""
        return self._monitor.request if self.active else _NOT_READY

    def begin(self) -> None:
        """Publish the request of the monitor, because the node has become active.

        If the monitor requests no stop, the request NotReady is withdrawn.
        """
        self.active = True
        self._shown = self.request
        self.output.send(self._shown)
        self._on_shown()

    def end(self) -> None:
        """Request a stop, because the node is no longer active."""
        self.active = False
        self.show()

    def show(self) -> None:
        """Publish the request if it has changed."""
        request = self.request
        if request == self._shown:
            return
        self._shown = request
        self.output.send(request)
        self._on_shown()
        if request is _NOT_READY:
            self._node.get_logger().info(f'stop: {request.reason}: {request.reason.hint}')
        elif request is not None:
            self._node.count(request.reason)
            item = f'item {request.item_id}: ' if request.item_id else ''
            self._node.warn(f'stop: {item}{request.reason}: {request.hint}')

    def add_status(self, status: StreamStatus) -> None:
        """Request a stop if the status of the driver reports a problem."""
        failed = 'its source failed' if status.state == StreamState.FAILED else ''
        finished = status.state == StreamState.FINISHED
        self._monitor.trouble = '' if finished else status.text or failed
        self._check()

    def _on_conditions(self, conditions: MachineConditions) -> None:
        self._monitor.conditions = conditions
        self._check()

    def _on_test(self, test: PerformanceTest) -> None:
        self._monitor.test = test
        self._check()

    def _look(self) -> None:
        """Check the publishers of the line, and the time limit of the performance test."""
        self._monitor.strangers = self.strangers.look()
        self._check()

    def _check(self) -> None:
        """Request a stop if the line, the machine or the performance test gives a reason."""
        self._monitor.check(time.time_ns())
        self._update()

    def _reset(self, request: Any, response: Any) -> Any:
        """Clear the stop request. If a reason for a stop persists, a stop is requested again."""
        cleared, shown = self._monitor.request, self._shown
        self._monitor.strangers = self.strangers.look()
        # Ignore the last message of a publisher that has ended.
        if not self._driver.count():
            self._monitor.trouble = ''
        if not self._conditions.count():
            self._monitor.conditions = MachineConditions(0, True)
        if not self._tests.count():
            self._monitor.test = None
        self._monitor.reset(time.time_ns())
        self._update()
        self.show()
        request = self.request
        if request is not None and request == shown:
            # Send an unchanged request again, because the driver waits for a request after a reset.
            self.output.send(request)
        response.success = request is None
        if request is not None:
            response.message = f'{request.reason}: {request.hint}'
        elif cleared is not None:
            response.message = f'{cleared.reason} reset'
        else:
            response.message = 'no stop was requested'
        return response
