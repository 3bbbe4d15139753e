# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items come when the samples have reached their edges, as the eyes had shown them by then."""

import numpy as np
import pytest

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, SampleBlock
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.segmentation.item_source import ItemSource
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.zero_keeper import ZeroKeeper

MS = NANOSECONDS // 1000
WHOLE = [(1000, 0, True), (1100, 0, False), (1200, 1, True), (1300, 1, False)]


@pytest.fixture
def buffer(load_cell):
    return SampleBuffer(load_cell.sample_rate, 10.0)


@pytest.fixture
def source(load_cell, buffer):
    parameters = SegmenterParameters()
    zero = ZeroKeeper(load_cell, parameters, buffer)
    return ItemSource(load_cell, parameters, buffer, zero, 0)


def _edges(*events):
    return [EyeEdge(ms * MS, Eye(eye), blocked) for ms, eye, blocked in events]


def _fill(buffer, seconds):
    size = round(seconds * buffer.sample_rate)
    buffer.append(SampleBlock(0, 0, np.zeros(size, np.int32)))


def test_edges_wait_for_the_samples(source, buffer):
    assert [item for edge in _edges(*WHOLE) for item in source.add(edge)] == []

    _fill(buffer, 1.1)
    assert source.advance() == []
    _fill(buffer, 1.3)

    assert [item.t3 for item in source.advance()] == [1200 * MS]


def test_later_edges_do_not_change_an_item(source, buffer):
    _fill(buffer, 2.0)
    source.advance()

    (item,) = [item for edge in _edges(*WHOLE) for item in source.add(edge)]

    assert item.t4 is None


def test_what_never_leaves_is_given_up_on_the_slowest_belt(source, buffer):
    for edge in _edges(*WHOLE[:2]):
        source.add(edge)
    _fill(buffer, 1.0 + 2.0 + 2.0)  # t1, 0.2 m at 0.1 m/s, and the lateness of edges
    assert source.advance() == []
    _fill(buffer, 5.1)

    assert [list(item.faults) for item in source.advance()] == [[Reason.MISSING_EDGE]]


def test_at_the_end_no_edge_waits_any_more(source):
    for edge in _edges(*WHOLE[:3]):
        source.add(edge)

    assert [item.t3 for item in source.finish_edges()] == [1200 * MS]
    assert source.give_up(Reason.STREAM_ENDED) == []
