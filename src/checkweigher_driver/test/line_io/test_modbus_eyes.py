# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eyes over Modbus TCP, against a server process on a real port."""

import time

from modbus_machine import BAG, MS, reading
import pytest
from running import wait_for

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import NANOSECONDS, EyeEdge
from checkweigher_driver.line_io.modbus import ModbusEyesParameters, ModbusOutputParameters
from checkweigher_driver.line_io.modbus_link import ModbusLink, ModbusLinkError
from checkweigher_driver.sources import EyesBack, EyesLost
from checkweigher_recording.bags.reading import read_bag


def test_the_edges_of_a_bag_come_with_the_uncertainty_that_is_stated(plc):
    recording = read_bag(BAG)
    skipped = 1.5  # s, of two of empty belt
    begin = recording.blocks[0].stamp + round(skipped * NANOSECONDS)
    start = plc.start('--bag', BAG, '--skip', skipped)
    truth = [
        (edge.stamp - begin + start, edge.eye, edge.blocked)
        for edge in recording.edges
        if edge.stamp - begin < 2 * NANOSECONDS
    ]
    # However busy the machine is on which the test runs: no edge is to be lost for it.
    with reading(plc, max_uncertainty=0.5, longest_gap=1.0, timeout=1.0) as (eyes, events):
        wait_for(lambda: len(events) >= len(truth), 'all edges')
        figures = eyes.figures()
        assert eyes.trouble == ''

    found = [event for event in events if isinstance(event, EyeEdge)][: len(truth)]
    assert [(edge.eye, edge.blocked) for edge in found] == [(eye, on) for _, eye, on in truth]
    errors = [edge.stamp - stamp for edge, (stamp, _, _) in zip(found, truth, strict=True)]
    worst = max(map(abs, errors))
    stated = figures['largest edge uncertainty ms'] * MS
    print(f'{len(truth)} edges, worst error {worst / MS:.3f} ms, {figures}')
    assert worst <= stated
    assert figures['eye losses'] == 0
    assert figures['edge uncertainty ms'] == pytest.approx(
        (figures['poll period ms'] + figures['round trip ms']) / 2
    )


def test_a_device_that_dies_loses_the_eyes_and_comes_back_without_an_invented_edge(plc):
    plc.start()
    with reading(plc, timeout=1.0) as (eyes, events):  # a busy host may answer after 0.1 s
        wait_for(lambda: eyes.figures()['polls'] > 10, 'polls')
        plc.kill()
        wait_for(lambda: events, 'the loss')
        assert 'the photo-eyes cannot be read' in eyes.trouble
        assert f'127.0.0.1:{plc.port}' in eyes.trouble
        killed = time.time_ns()
        # It comes back in the middle of a product.
        recording = read_bag(BAG)
        entered, on = (edge.stamp - recording.blocks[0].stamp for edge in recording.edges[:2])
        plc.start('--bag', BAG, '--skip', 0.5 * (entered + on) / NANOSECONDS)
        wait_for(lambda: any(isinstance(event, EyesBack) for event in events), 'the eyes')
        wait_for(lambda: isinstance(events[-1], EyeEdge), 'an edge')

    lost, back = events[0], events[1]
    assert isinstance(lost, EyesLost)
    assert lost.stamp <= killed
    assert 'no connection' in lost.text or 'no answer' in lost.text
    assert isinstance(back, EyesBack)
    assert sum(isinstance(event, EyesLost) for event in events) == 1
    assert all(edge.stamp >= back.stamp - 10 * MS for edge in events[2:])
    assert eyes.trouble == ''


def test_a_device_that_is_not_there_is_waited_for(plc):
    with reading(plc, timeout=0.1) as (eyes, events):
        wait_for(lambda: events, 'the loss')
        assert 'check cable, address' in eyes.trouble
        plc.start()
        wait_for(lambda: isinstance(events[-1], EyesBack), 'the eyes')
        assert eyes.trouble == ''


def test_a_device_that_refuses_is_said_to(plc):
    plc.start()
    link = ModbusLink('127.0.0.1', plc.port, 1, 1.0)
    link.connect()
    with pytest.raises(ModbusLinkError, match='input 900 cannot be read: refused by the device'):
        link.read_inputs('discrete', [900])
    link.connect()
    assert link.read_inputs('discrete', range(3)) == {0: False, 1: False, 2: True}  # the belt runs
    link.close()


@pytest.mark.parametrize(
    ('kind', 'values', 'message'),
    [
        (ModbusEyesParameters, {'host': ' '}, r'modbus\.host: empty'),
        (ModbusEyesParameters, {'outfeed': 0}, r'modbus\.outfeed: 0 is the address of both eyes'),
        (ModbusEyesParameters, {'outfeed': 64}, r'differ by at most 63'),
        (ModbusEyesParameters, {'poll_period': 0.05}, r'is more than max_uncertainty'),
        (
            ModbusOutputParameters,
            {'stop': 0},
            r'modbus_outputs\.stop: coil 0 is also used for the rejector',
        ),
    ],
)
def test_parameters_that_cannot_be_are_refused(kind, values, message):
    with pytest.raises(ParameterError, match=message):
        kind(**values)
