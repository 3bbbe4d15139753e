# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of the line in the audit log."""

from collections.abc import Callable
from typing import Any

from checkweigher_dsp.production.audit_log import AuditError
from checkweigher_dsp.production.audit_trail import AuditTrail
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.line_parameters import LineParametersClient, RefusedError, python_value


class ParameterAudit:
    """Write down the parameters of each node when it is started, and each change from then on.

    `namespace` is that of the line; `warn` takes a warning for the log of the node. The parameters
    of the nodes `unread` are still to be read.
    """

    def __init__(
        self, namespace: str, line: LineParametersClient, trail: AuditTrail,
        warn: Callable[[str], object],
    ) -> None:  # fmt: skip
        self._namespace = namespace.rstrip('/')
        self._line = line
        self._trail = trail
        self._warn = warn
        self._events = 0
        self.unread = set(ports.NODES)

    def add_started(self, nodes: set[str]) -> None:
        """Take which nodes have been started."""
        self.unread |= nodes.intersection(ports.NODES)

    def take_event(self, event: Any) -> None:
        """Take a message ParameterEvent."""
        namespace, _, name = event.node.rpartition('/')
        if namespace != self._namespace:
            return
        self._events += 1
        if event.new_parameters:  # the node has just been started
            self.add_started({name})
        for change in event.changed_parameters:
            self._trail.parameter(event.node, change.name, python_value(change.value))

    async def read_started(self) -> None:
        """Compare the parameters of nodes that were started with those that they had last."""
        for node in ports.NODES:
            if node not in self.unread or not self._line.ready(node):
                continue
            events = self._events
            try:
                values = await self._line.get_all(node)
                if events == self._events:  # else the values may be those from before the event
                    self._trail.found(f'{self._namespace}/{node}', values)
                    self.unread.discard(node)
            except (AuditError, RefusedError) as error:
                self._warn(str(error))
