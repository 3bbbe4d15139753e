# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Client of the audit log, to which a node writes an entry before it makes a change."""

import json
import time

from checkweigher_msgs.srv import RecordChange
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from checkweigher_core.changes import plain
from checkweigher_core.ros import ports
from checkweigher_core.ros.line_parameters import in_time

_PATIENCE = 2.0  # longest wait for the answer of the service in s
_DISCOVERY = 3.0  # time in s after the start of the node for which a change waits for the service
_LOOK_PERIOD = 0.1  # time in s between two checks for the service
TIME_TO_CHANGE = _PATIENCE + 1.0  # longest time in s from a log entry to the change that it states


class ChangeRecord:
    """Client of the service that writes to the audit log of the lane.

    The service exists only if the lane has an audit log. After the client has discovered the
    service for the first time, its node makes no more changes without an entry.
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
        """Check whether the service exists. The node must call this method periodically."""
        self._needed = self._needed or self._client.service_is_ready()

    async def write(self, kind: str, subject: str, value: object) -> str:
        """Write an entry before a change is made.

        Returns the reason why the change must not be made, or an empty string if it may be made. If
        the service is not discovered within 3 s after the start of the node, the change may be made
        without an entry, because the lane is assumed to have no audit log.
        """
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
        # Refuse the change after a late answer. The node product may already have read the
        # parameters to check the entry, and would not see a later change.
        if answer is None or time.monotonic() - asked > _PATIENCE:
            return f'not in the audit log: the node product did not answer within {_PATIENCE:g} s'
        return '' if answer.success else f'not in the audit log: {answer.message}'
