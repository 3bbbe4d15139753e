# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Permission to run, which ends soon after a node of the line ends, and returns with the node.

The line is that of the command `run` with a process per node, on the machine of `belt_machine.py`.
The campaign prints the figures of docs/safety.md. `make test` halts each node once and kills one.
It does not check the times, because that needs an idle machine.
"""

from collections import defaultdict
import os
from pathlib import Path
import signal
import time

from belt_line import BeltLine, belt_line
import pytest
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node

from checkweigher_core.ros import ports

# Of each kind in the campaign: CHECKWEIGHER_EXAMPLES=5 make soak SOAK_ARGS='-k test_permission'
TRIALS = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '3'))
NODES = ('driver', 'segmenter', 'denoise', 'identifier', 'reject')
ONCE = [*((node, signal.SIGSTOP) for node in NODES), ('segmenter', signal.SIGKILL)]
CAMPAIGN = [(node, s) for node in NODES for s in (signal.SIGSTOP, signal.SIGKILL)] * TRIALS
LIMIT = 0.5  # s
HALT = 1.5  # s


class Heard:
    """Permission as a PLC with DDS uses it: a message with `run` holds until it expires."""

    def __init__(self, node: Node) -> None:
        self.runs = False
        self.changed = 0  # ns
        port = ports.PERMISSION
        node.create_subscription(
            port.type,
            port.name,
            lambda message: self._set(message.run),
            port.stage_qos,
            event_callbacks=SubscriptionEventCallbacks(
                deadline=lambda _: self._set(False), use_default_callbacks=False
            ),
        )

    def _set(self, runs: bool) -> None:
        if runs != self.runs:
            self.changed = time.time_ns()
        self.runs = runs


def operate(line: BeltLine, heard: Heard) -> None:
    """Clear the belt and press the button until the line may run."""

    def runs() -> bool:
        if line.stop_text():
            line.tell('clear')
            line.reset()
            time.sleep(0.1)
        return heard.runs and line.runs() and not line.stop_text()

    line.wait_for(runs, 'the permission')
    time.sleep(0.5)
    line.wait_for(runs, 'the permission')


def stopped_at(line: BeltLine, since: int) -> int:
    """Return the time in ns at which the machine has stopped the belt."""

    def stops() -> list[int]:
        stands = [each[0] for each in line.events() if each[1] in ('stop', 'watchdog')]
        return [when for when in stands if when > since]

    line.wait_for(lambda: bool(stops()), 'the stop of the belt')
    return stops()[0]


@pytest.mark.parametrize(
    'faults', [ONCE, pytest.param(CAMPAIGN, marks=pytest.mark.soak)], ids=['once', 'campaign']
)
def test_the_permission_is_gone_soon_after_a_node_is_and_comes_back(
    tmp_path: Path, faults: list[tuple[str, signal.Signals]]
):
    figures: dict[tuple[str, str], list[tuple[float, ...]]] = defaultdict(list)
    with belt_line(tmp_path, processes=True) as line:
        heard = Heard(line.node)
        operate(line, heard)
        for node, number in faults:
            began = time.time_ns()
            pid = line.signal(node, number)
            line.wait_for(lambda: not heard.runs, 'the end of the permission')
            gone, stood = heard.changed, stopped_at(line, began)
            time.sleep(max(0.0, HALT - (time.time_ns() - began) / 1e9))
            assert not heard.runs
            back = began
            if number == signal.SIGSTOP:
                os.kill(pid, signal.SIGCONT)
                back = time.time_ns()
            operate(line, heard)
            ends = (gone - began, stood - began, heard.changed - back)
            figures[node, number.name].append(tuple(1e-9 * each for each in ends))
        pid = line.signal('product', signal.SIGSTOP)
        changed = heard.changed
        time.sleep(HALT)
        os.kill(pid, signal.SIGCONT)
        assert heard.runs
        assert heard.changed == changed
    for (node, name), found in figures.items():
        gone_s, stood_s, back_s = (max(each) for each in zip(*found, strict=True))
        print(f'| `{node}` | {name} | {gone_s:.2f} s | {stood_s:.2f} s | {back_s:.1f} s |')
        if faults is CAMPAIGN:
            # The belt of a dead driver is stopped by the watchdog of the machine.
            assert max(gone_s, 0.0 if node == 'driver' else stood_s) < LIMIT
