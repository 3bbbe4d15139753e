# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A load cell and photo-eyes that are read beside each other."""

import queue
import threading

import numpy as np
import pytest
from serial_line import Reader

from checkweigher_core.parameters import Parameters
from checkweigher_core.records import Eye, EyeEdge, LoadCell, SampleBlock
from checkweigher_driver.sources import EdgeSource, EyesBack, EyesLost, Source
from checkweigher_driver.sources.machine import MachineSource

CELL = LoadCell(960.0, 5e5, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2)


class Scripted:
    """Yields what it is given."""

    parameters = Parameters

    def __init__(self, parameters=None):
        self.given = queue.SimpleQueue()

    def events(self):
        while (event := self.given.get()) is not None:
            if isinstance(event, Exception):
                raise event
            yield event

    def close(self):
        self.given.put(None)


class ScriptedCell(Scripted, Source):
    paced, load_cell, start_stamp = False, CELL, 0
    __iter__ = Scripted.events


class ScriptedEyes(Scripted, EdgeSource):
    pass


def block(number):
    return SampleBlock(number * 10_000_000, 10 * number, np.zeros(10, np.int32))


@pytest.fixture
def machine():
    cell, eyes = ScriptedCell(), ScriptedEyes()
    reader = Reader(MachineSource(cell, eyes))

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
    kinds = [type(event) for event in reader.events]
    assert kinds == [SampleBlock, EyeEdge, SampleBlock]


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
    reader = Reader(MachineSource(cell, eyes))
    cell.given.put(ValueError('another device answers'))
    reader.wait_for_end()
    assert str(reader.error) == 'another device answers'

    cell, eyes = ScriptedCell(), ScriptedEyes()
    reader = Reader(MachineSource(cell, eyes))
    eyes.close()  # by itself, not by the machine
    reader.wait_for_end()
    assert str(reader.error) == 'the source of the eyes has ended'


def test_a_machine_that_is_closed_ends_without_an_error():
    before = threading.active_count()
    reader = Reader(MachineSource(ScriptedCell(), ScriptedEyes()))
    reader.close()
    assert reader.error is None
    assert threading.active_count() == before
