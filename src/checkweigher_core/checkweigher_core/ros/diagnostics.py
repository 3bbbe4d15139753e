# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a node, published on /diagnostics once a second."""

from collections.abc import Callable, Iterable
import socket
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from checkweigher_core.health.findings import Finding, Level
from checkweigher_core.printable import one_line
from checkweigher_core.records import LoadCell
from checkweigher_core.ros.graph.connections import Connections
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.ports import DIAGNOSTICS
from checkweigher_core.ros.status_board import HOST

_PERIOD = 1.0  # time in s between two messages
_LOG_PERIOD = 1.0  # shortest time in s between two consecutive equal warnings in the log


class Diagnostics:
    """Publisher of the findings of a node.

    The first status of a message describes the node by its worst level, last warning, counters and
    host name. Each other status contains one finding, and is named '<node>: <Aspect>', as in the
    package diagnostic_updater. The function `diagnose` returns the findings at a time in s on the
    monotonic clock.
    """

    def __init__(self, node: PortNode, diagnose: Callable[[float], Iterable[Finding]]) -> None:
        self._node = node
        self._diagnose = diagnose
        self._counters: dict[str, int] = {}
        self._warning = self._last_warning = ''
        self._last_logged = ('', 0.0)
        self._hardware_id = 'checkweigher'
        self._output = node.output(DIAGNOSTICS)
        self.connections = Connections(node, time.monotonic())

    def start(self) -> None:
        """Start to publish the findings once a second."""
        self._node.create_timer(_PERIOD, self._publish)

    def set_hardware(self, load_cell: LoadCell) -> None:
        """Set the hardware ID of each status to the model and serial number of a load cell.

        If both are unknown, the hardware ID is ``checkweigher``.
        """
        self._hardware_id = (
            '/'.join(filter(None, (load_cell.model, load_cell.serial_number))) or 'checkweigher'
        )

    def count(self, name: str) -> None:
        """Count an event.

        The caller must hold `LOCK`, because callbacks in several threads count events.
        """
        self._counters[name] = self._counters.get(name, 0) + 1

    def warn(self, text: str) -> None:
        """Log a warning, and publish it in the next message of the node.

        A repeated text is logged at most once a second.
        """
        text = one_line(text)
        self._warning = self._last_warning = text
        now = time.monotonic()
        if text != self._last_logged[0] or now - self._last_logged[1] > _LOG_PERIOD:
            self._last_logged = (text, now)
            self._node.get_logger().warning(text)

    def _publish(self) -> None:
        now = time.monotonic()
        findings = [
            *self._found('Diagnostics', lambda: self._diagnose(now)),
            *self._found('Connections', lambda: [self.connections.finding(now)]),
        ]
        name = self._node.get_fully_qualified_name().lstrip('/')
        own = self._status(name, self._summary(findings))
        others = [self._status(f'{name}: {each.aspect}', each) for each in findings]
        message = DiagnosticArray(status=[own, *others])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._output.send(message)

    def _found(self, aspect: str, look: Callable[[], Iterable[Finding]]) -> list[Finding]:
        try:
            return list(look())
        except Exception as error:  # an exception of the diagnostics must not stop the line
            text = f'{type(error).__name__}: {error}'
            hint = 'report this defect of the diagnostics'
            return [Finding(aspect, Level.ERROR, text, hint)]

    def _summary(self, findings: list[Finding]) -> Finding:
        """Return the finding on the node as a whole, with the text of its worst finding.

        If no finding is an error, a new warning becomes the text of one message. Later messages
        contain the warning only as the value ``last warning``.
        """
        worst = max(findings, key=lambda finding: finding.level)
        level = worst.level
        text = f'{worst.aspect}: {worst.message}' if level > Level.OK else 'running'
        if self._warning and level <= Level.WARN:
            level, text = Level.WARN, self._warning
        self._warning = ''
        # Copy the counters, because other threads change them.
        values: dict[str, float | str] = {HOST: socket.gethostname(), **self._counters}
        if self._last_warning:
            values['last warning'] = self._last_warning
        return Finding('', level, text, values=values)

    def _status(self, name: str, finding: Finding) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=bytes([finding.level]),
            name=name,
            message=one_line(finding.message),
            hardware_id=self._hardware_id,
            values=[
                KeyValue(key=key, value=f'{v:.6g}' if isinstance(v, float) else one_line(v))
                for key, v in finding.values.items()
            ],
        )
