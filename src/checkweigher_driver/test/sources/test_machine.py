# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A load cell and photo-eyes that are read beside each other."""

from dataclasses import replace
import queue
import threading

import numpy as np
import pytest
from serial_line import Reader, SerialDevice

from checkweigher_core.parameters import Parameters
from checkweigher_core.records import Eye, EyeEdge, LoadCell, SampleBlock
from checkweigher_driver.devices import source_maker
from checkweigher_driver.sources import EdgeSource, EyesBack, EyesLost, Source
from checkweigher_driver.sources.machine import Machine
from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.estimation.identifier import Identifier
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter
from checkweigher_recording.bags.writing import write_bag
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate

CELL = LoadCell(960.0, 5e5, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2)


class ScriptedCell(Source):
    """Yields what it is given."""

    parameters = Parameters
    paced = False

    def __init__(self, parameters=None):
        self.load_cell, self.start_stamp = CELL, 0
        self.given = queue.SimpleQueue()

    def __iter__(self):
        while (event := self.given.get()) is not None:
            if isinstance(event, Exception):
                raise event
            yield event

    def close(self):
        self.given.put(None)


class ScriptedEyes(EdgeSource):
    parameters = Parameters

    def __init__(self, parameters=None):
        self.given = queue.SimpleQueue()

    def events(self):
        while (event := self.given.get()) is not None:
            yield event

    def close(self):
        self.given.put(None)


def block(number):
    return SampleBlock(number * 10_000_000, 10 * number, np.zeros(10, np.int32))


@pytest.fixture
def machine():
    cell, eyes = ScriptedCell(), ScriptedEyes()
    reader = Reader(Machine(cell, eyes))

    def give(device, event, count):
        """Give an event and wait until it has been taken, and so many events are out."""
        device.given.put(event)
        reader.wait_for(lambda: len(reader.events) == count)

    yield cell, eyes, reader, give
    reader.close()


def test_an_edge_comes_at_once_and_not_with_the_next_block(machine):
    cell, eyes, reader, give = machine
    give(cell, block(0), 1)
    give(eyes, EyeEdge(5, Eye.INFEED, True), 2)
    give(cell, block(1), 3)
    assert [type(event).__name__ for event in reader.events] == [
        'SampleBlock',
        'EyeEdge',
        'SampleBlock',
    ]


def test_without_eyes_no_samples_go_on(machine):
    cell, eyes, reader, give = machine
    give(cell, block(0), 1)
    eyes.given.put(EyesLost(1, 'modbus: no reply'))
    reader.wait_for(lambda: reader.source.trouble == 'modbus: no reply')
    for number in (1, 2):
        cell.given.put(block(number))
    reader.wait_for(lambda: reader.source.figures()['samples withheld without eyes'] == 20)
    eyes.given.put(EyesBack(2))
    reader.wait_for(lambda: reader.source.trouble == '')
    give(cell, block(3), 2)
    assert [event.first_index for event in reader.events] == [0, 30]


def test_even_the_shortest_time_without_eyes_leaves_a_gap(machine):
    cell, eyes, reader, give = machine
    give(cell, block(0), 1)
    eyes.given.put(EyesLost(1, 'modbus: no reply'))
    eyes.given.put(EyesBack(2))
    give(eyes, EyeEdge(5, Eye.INFEED, True), 2)
    cell.given.put(block(1))
    give(cell, block(2), 3)
    assert reader.events[-1].first_index == 20


def test_what_ends_a_device_ends_the_machine():
    cell, eyes = ScriptedCell(), ScriptedEyes()
    reader = Reader(Machine(cell, eyes))
    cell.given.put(ValueError('another device answers'))
    reader.wait_for_end()
    assert str(reader.error) == 'another device answers'

    cell, eyes = ScriptedCell(), ScriptedEyes()
    reader = Reader(Machine(cell, eyes))
    eyes.close()  # by itself, not by the machine
    reader.wait_for_end()
    assert str(reader.error) == 'eyes have ended'


def test_a_machine_that_is_closed_ends_without_an_error():
    before = threading.active_count()
    reader = Reader(Machine(ScriptedCell(), ScriptedEyes()))
    reader.close()
    assert reader.error is None
    assert threading.active_count() == before


def windows_of(load_cell, events):
    """Return the weigh windows of a line."""
    segmenter = Segmenter(load_cell, SegmenterParameters())
    found = []
    for event in events:
        found += segmenter.take(event)
    return found + segmenter.finish()


def mass_of(window):
    parameters = LineParameters()
    return (
        Identifier(parameters.identifier)
        .estimate(Denoiser(parameters.denoise).denoise(window))
        .mass
    )


def test_over_the_port_come_the_windows_and_masses_of_the_recording(tmp_path):
    recording = simulate(SimulationParameters(count=2, lead_in=1.1, speed=1.2, run_out=0.1, seed=3))
    write_bag(tmp_path / 'bag', recording.load_cell, recording)
    cell = recording.load_cell
    given = {
        'aed': {
            'port': str(tmp_path / 'port'),
            'counts_per_kg': cell.counts_per_kg,
            'zero_counts': cell.zero_counts,
            'capacity': cell.capacity,
            'weigh_length': cell.weigh_length,
        },
        'replayed': {'path': str(tmp_path / 'bag')},
    }
    device = SerialDevice(tmp_path / 'port', '--bag', tmp_path / 'bag')
    try:
        make = source_maker('aed', 'replayed', lambda kind: kind.from_mapping(given[kind.node]))
        reader = Reader(make())
        total = sum(len(b.counts) for b in recording.blocks)
        reader.wait_for(lambda: sum(
            len(e.counts) for e in list(reader.events) if isinstance(e, SampleBlock)
        ) >= total - 10)  # fmt: skip
        reader.close()
    finally:
        device.end()
    over_port = windows_of(reader.source.load_cell, reader.events)
    recorded = windows_of(cell, [*recording.blocks, *recording.edges])

    assert [w.reasons for w in over_port] == [()] * 2
    for found, expected in zip(over_port, recorded, strict=True):
        where = ('first_index', 'empty_begin', 'window_begin', 'window_end')
        assert [getattr(found, n) for n in where] == [getattr(expected, n) for n in where]
        np.testing.assert_array_equal(found.counts, expected.counts)
        # The clock is that of this machine, which may be busy: it moves by 0.2 % at most. What it
        # says of the speed goes into the mass, so that is compared at the same times.
        assert found.belt_speed == pytest.approx(expected.belt_speed, rel=0.005)
        times = ('t1', 't2', 't3', 'stamp', 'belt_speed', 'product_length', 'line_speed')
        same_times = replace(found, **{name: getattr(expected, name) for name in times})
        assert mass_of(same_times) == pytest.approx(mass_of(expected), abs=1 / cell.counts_per_kg)
