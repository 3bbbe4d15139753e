# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages too long and too many for a running line: it goes on, and its memory goes back."""

from array import array
from collections.abc import Callable
import os
from pathlib import Path
import queue
import random
from typing import Any

from checkweigher_msgs.msg import Verdict
from graph import heard, wait_for
from processes import parameter_file, resident_memory
import pytest
from rclpy.node import Node
from running import PATIENCE

from checkweigher_bringup.spinning import node_command, running_processes, spinning
from checkweigher_dsp.records import MAX_WINDOW, NANOSECONDS
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import stamp_from

LENGTH = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '2000000'))  # counts in a message
MOST = 1_000_000  # kB, that a node may take at any time
GOOD = 10


class Flooder(Node):
    """Publishes what no line can use, under a name that the line allows."""

    def __init__(self) -> None:
        super().__init__('flooder')
        self.verdicts = heard(self, ports.VERDICT)
        self.newest = 0  # stamp of the last item, ns
        flooded = ports.LOAD_CELL_SAMPLES, ports.WEIGH_WINDOW, ports.DENOISED_WINDOW, \
            ports.PHOTO_EYES  # fmt: skip
        self.outputs = {
            topic: self.create_publisher(topic.type, topic.name, topic.qos) for topic in flooded
        }

    def weighed(self, count: int) -> None:
        """Wait until so many items in a row have been weighed from now on."""
        while not self.verdicts.empty():
            self.verdicts.get()
        found = 0
        while found < count:
            try:
                _, verdict = self.verdicts.get(timeout=PATIENCE)
            except queue.Empty:
                raise AssertionError(f'silent after {found} of {count}') from None
            found = found + 1 if verdict.decision == Verdict.ACCEPT else 0
            self.newest = stamp_from(verdict.header.stamp)

    def send(self, topic: ports.Port, **values: Any) -> None:
        self.outputs[topic].publish(topic.type(**values))

    def arrived(self) -> None:
        """Wait until all subscribers have what was sent."""
        for output in self.outputs.values():
            assert output.wait_for_all_acked()


def long_blocks(flooder: Flooder, count: int) -> None:
    for index in range(count):
        flooder.send(
            ports.LOAD_CELL_SAMPLES, first_index=index, counts=array('i', bytes(4 * LENGTH))
        )


def long_windows(flooder: Flooder, count: int) -> None:
    for topic in (ports.WEIGH_WINDOW, ports.DENOISED_WINDOW):
        for number in range(count):
            for length in (LENGTH, MAX_WINDOW):
                flooder.send(
                    topic, item_id=10**6 + number, window_end=length, sample_rate=960.0,
                    counts_per_kg=5e5, belt_speed=1.0, counts=array('i', bytes(4 * length)),
                    denoised=array('d', bytes(8 * length)),
                )  # fmt: skip


def many_edges(flooder: Flooder, count: int) -> None:
    chance = random.Random(1)
    for _ in range(1000 * count):
        stamp = flooder.newest + chance.randrange(2 * NANOSECONDS)
        message = ports.PHOTO_EYES.type(eye=chance.randrange(2), blocked=chance.random() < 0.5)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
        flooder.outputs[ports.PHOTO_EYES].publish(message)


FLOODS: list[Callable[[Flooder, int], None]] = [long_blocks, long_windows, many_edges]


def flood_line(folder: Path, count: int) -> str:
    """Flood a running line, and check that it weighs and that its memory goes back."""
    file = parameter_file(
        folder / 'parameters.yaml',
        {
            '**': {'allowed_publishers': 'flooder'},
            'driver': {
                'rate': 2.0,
                'simulator.count': 0,
                'simulator.spacing': 0.4,
                'lossless': False,
            },
            'reject': {'deadlines': False},
        },
    )
    report = []
    with spinning() as spinner:
        flooder = Flooder()
        spinner.add(flooder)
        commands = {name: node_command(module, '', file) for name, module in ports.NODES.items()}
        with running_processes(commands) as processes:
            wait_for(lambda: all(o.get_subscription_count() for o in flooder.outputs.values()))
            flooder.weighed(GOOD)
            for flood in FLOODS:
                before = {name: resident_memory(p.pid) for name, p in processes.items()}
                flood(flooder, count)
                flooder.arrived()
                flooder.weighed(GOOD)
                for name, process in processes.items():
                    wait_for(lambda p=process, b=before[name]: resident_memory(p.pid) < 1.1 * b)
                    assert resident_memory(process.pid, 'VmHWM') < MOST, report
                after, most = (
                    {name: resident_memory(p.pid, what) for name, p in processes.items()}
                    for what in ('VmRSS', 'VmHWM')
                )
                report.append(
                    f'{flood.__name__}: kB before {before}, after {after}, most so far {most}'
                )
    return '\n'.join(report)


def test_a_flooded_line_weighs_again_and_its_memory_goes_back(tmp_path: Path):
    flood_line(tmp_path, 1)


@pytest.mark.soak
def test_long_floods(tmp_path: Path):
    print(f'\n{flood_line(tmp_path, 50)}')
