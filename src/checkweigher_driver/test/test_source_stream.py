# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A stream that is held back by a line that is not there, and one that is not."""

from functools import partial
from unittest.mock import MagicMock

from node_process import process  # noqa: F401
import pytest
from running import wait_for

from checkweigher_core.records import EyeEdge, SampleBlock, StreamState
from checkweigher_core.ros import ports
from checkweigher_driver import source_stream
from checkweigher_driver.devices import DriverParameters, source_class
from checkweigher_driver.health import DriverWatch
from checkweigher_driver.source_stream import SourceStream
from checkweigher_recording.simulation.simulator import SimulationParameters


@pytest.fixture
def line(process):  # noqa: F811
    """Return a function that begins the stream of a simulated line without segmenter and reject."""
    sent, warned, streams = [], [], []
    driver, listener = process.node(), process.node()
    driver.warn, driver.count = warned.append, lambda _: None
    for port in (ports.DRIVER_STATUS, ports.LOAD_CELL_SAMPLES, ports.PHOTO_EYES):
        listener.subscribe(port, partial(lambda port, record: sent.append((port, record)), port))

    def begin(**parameters):
        watch = MagicMock(spec=DriverWatch)
        given = DriverParameters(rate=0.0, **parameters)
        stream = SourceStream(driver, given, watch, lambda event: None, lambda: True)
        process.spinner.add(driver, listener)
        streams.append(stream)
        stream.begin(source_class('simulator')(SimulationParameters(count=2)))
        return stream, sent, warned

    yield begin
    for stream in streams:
        stream.end()


def test_a_recording_waits_for_a_segmenter_names_it_and_ends_when_it_is_told_to(line, monkeypatch):
    monkeypatch.setattr(source_stream, '_REMINDER', 0.05)
    stream, sent, warned = line(listeners=2)
    wait_for(lambda: len(warned) > 1, 'reminders')
    waited = 'a segmenter and 2 other listeners'
    assert set(warned) == {f'the source is held back: waiting for {waited}'}
    assert stream.end()
    assert not stream.end()
    assert {port for port, _ in sent} == {ports.DRIVER_STATUS}


def test_a_recording_that_is_not_held_back_is_sent_as_a_whole_without_a_line(line, monkeypatch):
    monkeypatch.setattr(source_stream, '_PATIENCE', 0.05)
    _, sent, warned = line(lossless=False)
    wait_for(
        lambda: sent and getattr(sent[-1][1], 'state', None) == StreamState.FINISHED, 'the end'
    )
    status = sent[-1][1]
    events = [record for _, record in sent]
    assert status.edges == sum(isinstance(event, EyeEdge) for event in events) == 8
    blocks = [event for event in events if isinstance(event, SampleBlock)]
    assert status.samples == sum(len(block.counts) for block in blocks)
    assert status.stamp == blocks[-1].stamp
    assert warned == ['the stream begins without a segmenter and an active reject node']
