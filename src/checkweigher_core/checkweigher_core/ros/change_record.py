# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Entries in the audit log of a lane, which a node writes before it makes a change."""

import json
import time

from checkweigher_msgs.srv import RecordChange
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from checkweigher_core.changes import plain
from checkweigher_core.ros import ports
from checkweigher_core.ros.line_parameters import in_time

_PATIENCE = 2.0  # s, for the answer
_DISCOVERY = 3.0  # s after the start of the node, in which the service may still appear
_LOOK_PERIOD = 0.1  # s

# A change is made within this time in s after its entry, or not at all.
TIME_TO_CHANGE = _PATIENCE + 1.0


class ChangeRecord:
    """Client of the node with the audit log of the lane.

    That node offers the service only if it has a log. Once this client has seen the service, its
    own node makes no more changes without an entry.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._group = ReentrantCallbackGroup()
        self._client = node.create_client(
            RecordChange, ports.RECORD_CHANGE, callback_group=self._group
        )
        self._began = time.monotonic()
        self._needed = False

    def look(self) -> None:
        """Check whether there is a log; call this periodically."""
        self._needed = self._needed or self._client.service_is_ready()

    async def write(self, kind: str, subject: str, value: object) -> str:
        """Write a change before it is made; return why it must not be made, empty if it may."""
        self.look()
        while not self._needed and time.monotonic() - self._began < _DISCOVERY:
            await in_time(self._node, self._group, Future(), _LOOK_PERIOD)
            self.look()
        if not self._needed:
            return ''
        request = RecordChange.Request(
            kind=kind, subject=subject, new_value=json.dumps(plain(value), allow_nan=False)
        )
        asked, answer = time.monotonic(), None
        if self._client.service_is_ready():
            future = self._client.call_async(request)
            answer = await in_time(self._node, self._group, future, _PATIENCE)
            self._client.remove_pending_request(future)
        # A process that was halted may get an answer late, after further entries in the log.
        if answer is None or time.monotonic() - asked > _PATIENCE:
            return f'not in the audit log: no answer of the node product for {_PATIENCE:g} s'
        return '' if answer.success else f'not in the audit log: {answer.message}'
