# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a person is told of an action, and what the audit log is."""

import asyncio
from collections.abc import Iterator
from typing import Any

from checkweigher_msgs.srv import RecordChange
import pytest
import rclpy

from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.spinner import Spinner
from checkweigher_web.work.services import ActionRefusedError, LaneServices, Outcome, Person

ANNA = Person('anna', '127.0.0.1')


class AuditLog(PortNode):
    """A node that takes what is to be written into an audit log."""

    def __init__(self) -> None:
        super().__init__('product')
        self.texts: list[str] = []
        self.create_service(RecordChange, ports.RECORD_CHANGE, self._take)

    def _take(self, request: Any, response: Any) -> Any:
        if request.new_value != 'null':  # else it says which services are about to be called
            self.texts.append(request.new_value)
        response.success = True
        return response


async def done() -> str:
    return 'zeroed'


async def refused() -> str:
    raise ActionRefusedError('the belt is not empty')


async def failed() -> str:
    empty: list[int] = []
    return str(empty[0])


@pytest.fixture
def spinner() -> Iterator[Spinner]:
    """Have ROS, and what serves nodes."""
    rclpy.init()
    spinner = Spinner()
    yield spinner
    spinner.stop()
    rclpy.try_shutdown()


def test_each_end_of_an_action_is_told_and_written_down(spinner: Spinner):
    log, services = AuditLog(), LaneServices('')
    spinner.add(log, services)
    asyncio.run(services.found(ports.RECORD_CHANGE))
    cases = (
        (done, Outcome(True, 'zeroed'), 'done'),
        (refused, Outcome(False, 'the belt is not empty'), 'refused: the belt is not empty'),
        (
            failed, Outcome(False, 'it failed: IndexError: list index out of range'),
            'failed: IndexError: list index out of range',
        ),
    )  # fmt: skip
    for action, outcome, ending in cases:
        log.texts.clear()
        assert asyncio.run(services.act(ANNA, 'zero', '', action)) == outcome
        assert log.texts == ['"zero: asked from 127.0.0.1"', f'"zero: {ending}"']
