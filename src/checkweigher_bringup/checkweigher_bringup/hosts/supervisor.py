# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node that tells of a host of a line: how its clock agrees with those of the others."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.utilities import remove_ros_args

from checkweigher_bringup.hosts.chrony import Chrony
from checkweigher_bringup.hosts.clocks import HostClocks, answering
from checkweigher_bringup.hosts.description import LayoutError, LineDescription, read_line
from checkweigher_bringup.spinning import asked_to_end, spinning
from checkweigher_bringup.supervision import CANNOT_START
from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.health.host_clocks import SUPERVISOR
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.diagnostics import status_of
from checkweigher_dsp.ros.port_node import PortNode

_CLOCK_PERIOD, _POLL_PERIOD = 1.0, 0.1  # s


class Supervisor(PortNode):
    """Supervisor of a host of a line; by its name and place the graph shows who is on that host."""

    def __init__(self, host: str) -> None:
        super().__init__(f'{SUPERVISOR}{host}')
        self._output = self.output(ports.DIAGNOSTICS)

    def hear_nodes(self, heard: Callable[[str], None]) -> None:
        """Have a callback called with the full name of each node that reports, of any lane."""

        def hear(message: Any) -> None:
            for status in message.status:
                heard(status.name.strip('/').partition(':')[0])

        # An input would be connected with the output of this node, and to nobody else.
        port = ports.DIAGNOSTICS
        self.create_subscription(port.type, port.name, hear, port.stage_qos)

    def tell_clocks(self, clocks: HostClocks) -> None:
        """Publish from now on how the clocks of the other hosts are, and log what has changed."""
        levels: dict[str, Level] = {}

        def tell() -> None:
            statuses = []
            for each in clocks.findings():
                if levels.get(each.aspect) != each.level:
                    say = self.get_logger().info if each.level == Level.OK else self.warn
                    say(f'{each.aspect}: {each.message}')
                levels[each.aspect] = each.level
                statuses.append(status_of(f'{self.get_name()}: {each.aspect}', each))
            message = DiagnosticArray(status=statuses)
            message.header.stamp = self.get_clock().now().to_msg()
            self._output.send(message)

        self.create_timer(_CLOCK_PERIOD, tell)


@contextmanager
def comparing_clocks(line: LineDescription, host: str, node: Supervisor) -> Iterator[None]:
    """Have a node tell of the clocks of the hosts that are compared with this one, if any are."""
    others = line.compared_with(host)
    with ExitStack() as stack:
        if others:
            address = line.hosts[host]
            chrony = stack.enter_context(Chrony())
            try:
                stack.enter_context(answering(address, chrony=chrony))
                clocks = HostClocks(address, others, chrony=chrony)
                stack.callback(clocks.close)
                node.tell_clocks(clocks)
            except OSError as error:  # the lanes run all the same
                text = f'clocks are not compared: {address}: {error.strerror or error}'
                print(f'{host}: {text}', file=sys.stderr, flush=True)
        yield


def main() -> None:
    """Compare the clocks of a line, whose description and host the command line names."""
    _, path, host = remove_ros_args(sys.argv)
    try:
        line = read_line(Path(path))
        line.shares(host)
    except LayoutError as error:
        print(f'supervisor: {error}', file=sys.stderr)
        raise SystemExit(CANNOT_START) from None
    with asked_to_end() as asked, spinning() as spinner:
        node = Supervisor(host)
        with comparing_clocks(line, host, node):
            spinner.add(node)
            while not asked:
                time.sleep(_POLL_PERIOD)
    raise SystemExit(128 + asked[0])


if __name__ == '__main__':
    main()
