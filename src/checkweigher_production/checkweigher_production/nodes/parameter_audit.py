# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of the line in the audit log."""

from collections.abc import Callable, Mapping
import math
import time

from checkweigher_core.ros import ports
from checkweigher_core.ros.change_record import TIME_TO_CHANGE
from checkweigher_core.ros.line_parameters import LineParametersClient, RefusedError, Values
from checkweigher_production.audit_log import AuditError
from checkweigher_production.audit_trail import AuditTrail
from checkweigher_production.authors import Author


class ParameterAudit:
    """Write down the parameters of each node when it is started, and changes before they are made.

    What was written and yet not set is found when the parameters are read again afterwards.
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
        self._announced: dict[str, float] = {}  # when, of nodes that are to be read again
        self.unread = set(ports.NODES)

    def add_started(self, nodes: set[str]) -> None:
        """Take which nodes have been started."""
        self.unread |= nodes.intersection(ports.NODES)

    def announce(self, changes: Mapping[str, Values], by: Author) -> None:
        """Write down what parameters of some nodes are about to become.

        `AuditError` if that cannot be written: then they must not.
        """
        for node, values in changes.items():
            if node not in ports.NODES:
                raise AuditError(f'{node}: is no node of the line')
            self._announced[node] = time.monotonic()
            self._trail.parameters(f'{self._namespace}/{node}', values, by)

    async def read_started(self) -> None:
        """Compare the parameters of nodes with those that they should have by the log."""
        for node in ports.NODES:
            began = time.monotonic()
            changed = began - self._announced.get(node, math.inf) > TIME_TO_CHANGE
            if not (changed or node in self.unread) or not self._line.ready(node):
                continue
            try:
                values = await self._line.get_all(node)
                # Else the values may be those from before a change that was announced meanwhile.
                if self._announced.get(node, -math.inf) < began:
                    self._trail.found(f'{self._namespace}/{node}', values)
                    self.unread.discard(node)
                    if changed:
                        del self._announced[node]
            except (AuditError, RefusedError) as error:
                self._warn(str(error))
