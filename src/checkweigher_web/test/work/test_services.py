# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Outcomes of an action for the user, and its entries in the audit log."""

import asyncio
from typing import Any

from checkweigher_msgs.srv import RecordChange
from node_process import spinning
import pytest

from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_web.work.services import ActionRefusedError, LaneServices, Outcome, Person

ANNA = Person('anna', '127.0.0.1')
INDEX = 'failed: IndexError: list index out of range'


class AuditLog(PortNode):
    """Node that stores the entries that an audit log would get."""

    def __init__(self) -> None:
        super().__init__('product')
        self.texts: list[str] = []
        self.create_service(RecordChange, ports.RECORD_CHANGE, self._take)

    def _take(self, request: Any, response: Any) -> Any:
        if request.new_value != 'null':  # null announces service calls
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


@pytest.mark.parametrize(
    ('action', 'outcome', 'ending'),
    [
        (done, Outcome(True, 'zeroed'), 'done'),
        (refused, Outcome(False, 'the belt is not empty'), 'refused: the belt is not empty'),
        (failed, Outcome(False, f'it {INDEX}'), INDEX),
    ],
)
def test_each_end_of_an_action_is_told_and_written_down(action, outcome: Outcome, ending: str):
    with spinning() as spinner:
        log, services = AuditLog(), LaneServices('')
        spinner.add(log, services)
        asyncio.run(services.found(ports.RECORD_CHANGE))
        assert asyncio.run(services.act(ANNA, 'zero', '', action)) == outcome
        assert log.texts == ['"zero: asked from 127.0.0.1"', f'"zero: {ending}"']
