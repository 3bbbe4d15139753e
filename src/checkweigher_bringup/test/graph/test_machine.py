# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Graph on a machine: load cell on a serial port, photo-eyes, rejector and stop over Modbus TCP.

The load cell and the PLC are separate programs, which play the same bag from the same moment.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
import math
from pathlib import Path
import queue
from statistics import median
import time
from typing import Any

from graph import aspect, call
from modbus_machine import MS, REJECTOR, RELEASE, Plc, outputs_of
import numpy as np
import pytest
from rclpy.node import Node
from running import BAGS, PATIENCE, wait_for
from serial_line import SerialDevice, aed_on
from std_srvs.srv import Trigger

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner, spinning
from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS, Decision, EyeEdge, SampleBlock, Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_record
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_recording.bags.reading import read_bag

_MOST_MISSED = 20  # samples at the start of the port
_PASS = 0.1  # s, less than any pass takes
_SETTLED = 10.0  # s
_OF_CLOCK = 0.1  # of a mass, by which it is off where the clock is off by 1 during the pass
UNCERTAINTY = {'modbus': 1.3e-3, 'replayed': 0.0}  # s, of a poll each 2 ms
LIMITS = {'lower_limit': 0.12, 'upper_limit': 0.2, 'rejector_distance': 0.6}
# However busy the machine is on which the test runs.
PATIENT = {'modbus.timeout': 2.0, 'modbus.longest_gap': 1.0, 'modbus.max_uncertainty': 0.2}


@dataclass
class Line:
    """Running line, and the messages from it."""

    spinner: Spinner
    node: Node
    device: SerialDevice
    plc: Plc
    driver: DriverNode
    verdicts: 'queue.SimpleQueue[Any]'
    stops: list[Any]
    blocks: list[SampleBlock]
    edges: list[EyeEdge]

    def take(self, count: int) -> list[Verdict]:
        return [to_record(ports.VERDICT, self.verdicts.get(timeout=PATIENCE)) for _ in range(count)]

    def reset(self) -> bool:
        return bool(call(self.node, Trigger, ports.RESET_STOP_REQUEST).success)


@contextmanager
def machine(folder: Path, bag: Path, recording: Recording, eyes: str) -> Iterator[Line]:
    """Run the graph on the two programs."""
    cell, begin, port = recording.load_cell, folder / 'begin', folder / 'port'
    plc = Plc(folder)
    plc.start('--bag', bag, '--begin', begin, '--watchdog', 5.0)
    device = SerialDevice(port, '--bag', bag, '--begin', begin, '--rate', cell.sample_rate)
    try:
        with spinning('machine') as spinner:
            node, heard, stops = Node('listener'), queue.SimpleQueue(), []
            blocks, edges, samples = [], [], ports.LOAD_CELL_SAMPLES
            for topic, take in (
                (ports.VERDICT, heard.put),
                (ports.STOP_REQUEST, stops.append),
                (samples, lambda each: blocks.append(to_record(samples, each))),
                (ports.PHOTO_EYES, lambda each: edges.append(to_record(ports.PHOTO_EYES, each))),
            ):
                node.create_subscription(topic.type, topic.name, take, topic.stage_qos)
            spinner.add(node)
            own = {'reject': LIMITS, 'denoise': {'edge_uncertainty': UNCERTAINTY[eyes]}}
            for name, make in STAGE_NODES.items():
                spinner.add(make(own.get(name)))
            driver = DriverNode(
                {
                    **aed_on(port, cell),
                    **outputs_of(plc),
                    **PATIENT,
                    'eyes': eyes,
                    'modbus.host': '127.0.0.1',
                    'modbus.port': plc.port,
                    'replayed.path': str(bag),
                }
            )
            spinner.add(driver)
            yield Line(spinner, node, device, plc, driver, heard, stops, blocks, edges)
    finally:
        device.end()
        plc.kill()


def seen_by(line: Line, recording: Recording) -> tuple[list[EyeEdge], list[float], float, float]:
    """Return the edges as they were read, on the time of the bag, and the errors of this time.

    Each edge is placed between the same two samples of the bag as in the published stream.

    Returns
    -------
    edges : list of EyeEdge
    errors : list of float
        Differences between the stamps and the times of the PLC in ms.
    drift, late_drift : float
        Largest relative error of the time between samples that are as far apart as in a pass, of
        all samples, and of those at least 10 s after the first one.
    """
    blocks, rate = line.blocks, recording.load_cell.sample_rate
    counts = np.concatenate([block.counts for block in recording.blocks])
    # The source may have found the first frame only after some: it counts from there.
    missed = next(
        number
        for number in range(_MOST_MISSED)
        if np.array_equal(blocks[0].counts, counts[number:][: len(blocks[0].counts)])
    )
    for block in blocks:  # the readings are those of the bag, none lost
        first = block.first_index + missed
        assert np.array_equal(block.counts, counts[first:][: len(block.counts)])
    starts = [block.stamp for block in blocks]
    period, begin = NANOSECONDS / rate, recording.blocks[0].stamp
    edges = []
    for edge in line.edges:
        block = blocks[max(bisect_right(starts, edge.stamp) - 1, 0)]
        place = (block.first_index + missed) * period + edge.stamp - block.stamp
        edges.append(replace(edge, stamp=begin + round(place)))
    played = {(edge.eye, edge.blocked): [] for edge in recording.edges}
    for edge in recording.edges:
        played[edge.eye, edge.blocked].append(edge.stamp)
    errors = [
        min((edge.stamp - true for true in played[edge.eye, edge.blocked]), key=abs) / MS
        for edge in edges
    ]
    step = round(_PASS * rate / len(blocks[0].counts))
    drifts = [
        abs((late.stamp - early.stamp) / ((late.first_index - early.first_index) * period) - 1)
        for early, late in zip(blocks, blocks[step:], strict=False)
    ]
    begun = sum(block.first_index <= _SETTLED * rate for block in blocks)
    return edges, errors, max(drifts), max(drifts[begun:], default=math.nan)


def weighed(recording: Recording, edges: Sequence[EyeEdge], uncertainty: float) -> list[float]:
    """Return the masses of `weigh` on a bag with these edges."""
    parameters = LineParameters().with_values({'denoise.edge_uncertainty': uncertainty})
    line = WeighingLine(recording.load_cell, parameters)
    events = sorted([*recording.blocks, *edges], key=lambda event: event.stamp)
    return [done.estimate.mass for event in events for done in line.add(event)]


def check_rejects(line: Line, verdicts: list[Verdict]) -> list[float]:
    """Check that the coil follows the verdicts, and return the delays of the pulses in ms."""
    switches = line.plc.switches(REJECTOR)
    ons = [when for when, on in switches if on]
    late = []
    for verdict in verdicts:
        assert verdict.reject_at is not None
        if verdict.decision == Decision.ACCEPT:
            # In the middle of the time in which the rejector would act.
            assert line.plc.state(REJECTOR, verdict.reject_at + 50 * MS) is False
        else:
            nearest = min(ons, key=lambda when: abs(when - verdict.reject_at))
            late.append((nearest - verdict.reject_at) / MS)
    figures: Any = aspect(line.driver, 'Outputs').values
    stated = figures['largest_switch_error_ms'] + figures['switch_uncertainty_ms']
    assert min(late) > 0
    assert max(late) <= stated + 0.5
    return late


def run(folder: Path, bag: Path, count: int, eyes: str) -> None:
    """Weigh the first items of a bag on the machine, and compare them with `weigh`."""
    recording = read_bag(bag)
    cell = recording.load_cell
    with machine(folder, bag, recording, eyes) as line:
        began, cpu = time.monotonic(), time.process_time()
        verdicts = line.take(count)
        lasted, cpu = time.monotonic() - began, time.process_time() - cpu
        last = max(each.reject_at or 0 for each in verdicts) + 200 * MS
        wait_for(lambda: time.time_ns() > last, 'the last item')
        figures: Any = aspect(line.driver, 'Source').values
        assert line.plc.state(RELEASE) is True, (aspect(line.driver, 'Outputs'), figures)
        late = check_rejects(line, verdicts)
    edges, off, drift, late_drift = seen_by(line, recording)
    # What remains when the edges are where the PLC was read is the clock of the samples.
    count_mass = 1 / cell.counts_per_kg
    masses = [each.mass for each in verdicts]
    expected, plain = (
        weighed(recording, each, UNCERTAINTY[eyes])[:count] for each in (edges, recording.edges)
    )
    # An edge that was read so late that the item is a fault makes it one for both.
    assert [math.isnan(mass) for mass in masses] == [math.isnan(mass) for mass in expected]
    sound = [number for number, mass in enumerate(masses) if not math.isnan(mass)]
    assert len(sound) > count / 2
    errors = [masses[number] - expected[number] for number in sound]
    changed = [masses[number] - plain[number] for number in sound]
    within = sum(abs(error) <= count_mass for error in changed)
    print(
        f'{bag.name}, eyes {eyes}: {count} items, largest difference from weigh '
        f'{1e6 * max(map(abs, errors)):.2f} mg with the edges as read, '
        f'{1e6 * max(map(abs, changed)):.2f} mg (median {1e6 * median(map(abs, changed)):.2f} mg) '
        f'with those of the bag, {within} within a count; '
        f'one count {1e6 * count_mass:.2f} mg, clock {1e6 * drift:.0f} ppm, '
        f'after 10 s {1e6 * late_drift:.0f} ppm, '
        f'edges {min(off):+.2f} to {max(off):+.2f} ms; {len(late)} rejected, {min(late):.2f} to '
        f'{max(late):.2f} ms after their time; CPU {cpu / lasted:.1%}; {figures}'
    )
    assert figures['samples_lost'] == 0
    for error, number in zip(errors, sound, strict=True):
        assert abs(error) <= count_mass + _OF_CLOCK * drift * masses[number]
    # A sample for the clock, which is fitted within the first seconds.
    doubt = figures.get('largest_edge_uncertainty_ms', 0.0) + 1e3 / cell.sample_rate
    assert max(map(abs, off)) <= doubt
    assert [each.decision for each in verdicts] == [decided(mass) for mass in expected]


def decided(mass: float) -> Decision:
    if math.isnan(mass):
        return Decision.FAULT
    over = Decision.OVER if mass > LIMITS['upper_limit'] else Decision.ACCEPT
    return Decision.UNDER if mass < LIMITS['lower_limit'] else over


# It holds devices, DDS and clocks to milliseconds of real time: not beside other work.
@pytest.mark.soak
def test_the_first_items_of_a_bag_on_a_machine(tmp_path: Path):
    run(tmp_path, BAGS / 'paper_90', 6, 'modbus')


@pytest.mark.soak
@pytest.mark.parametrize('eyes', ['modbus', 'replayed'])
@pytest.mark.parametrize('bag', ['paper_60', 'paper_90'])
def test_a_whole_bag_on_a_machine(tmp_path: Path, bag: str, eyes: str):
    run(tmp_path, BAGS / bag, 25, eyes)


@pytest.mark.soak
def test_a_load_cell_that_is_unplugged_stops_the_line_until_it_is_back_and_reset(tmp_path: Path):
    bag = BAGS / 'paper_60'
    with machine(tmp_path, bag, read_bag(bag), 'modbus') as line:
        line.take(3)
        assert line.plc.state(RELEASE) is True
        line.device.tell('unplug')
        pulled = time.time_ns()
        wait_for(lambda: line.plc.state(RELEASE) is False, 'the stop output')
        stopped = line.plc.switches(RELEASE)[-1][0]
        wait_for(lambda: line.stops and line.stops[-1].reason == 'DriverTrouble', 'the request')
        assert not line.reset()  # it still is unplugged
        while line.take(1)[0].decision != Decision.FAULT:
            pass  # what had left the belt
        faulted = time.time_ns()
        line.device.tell('replug')
        plugged = time.monotonic()
        wait_for(line.reset, 'the end of the trouble')
        wait_for(lambda: line.plc.state(RELEASE) is True, 'the release of the belt')
        released = time.monotonic()
        faults = 1
        while (verdict := line.take(1)[0]).decision == Decision.FAULT:
            faults += 1
        print(
            f'stopped {(stopped - pulled) / MS:.0f} ms after the unplug, the first fault '
            f'{(faulted - pulled) / MS:.0f} ms; released '
            f'{released - plugged:.2f} s and weighed {time.monotonic() - plugged:.2f} s after the '
            f'replug; {faults} faults; item {verdict.item_id}: {1e3 * verdict.mass:.3f} g'
        )
