# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the canonical order of events."""

from random import Random

import numpy as np

from checkweigher_core.recording import Recording
from checkweigher_core.records import Eye, EyeEdge, LoadCell, Reference, SampleBlock

CELL = LoadCell(960.0, 5e5, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2)
COUNTS = np.zeros(10, np.int32)
EVENTS = [
    SampleBlock(0, 0, COUNTS),
    EyeEdge(5, Eye.INFEED, True),
    Reference(5, 0.1),
    EyeEdge(10, Eye.INFEED, False),
    EyeEdge(10, Eye.OUTFEED, True),
    SampleBlock(10, 10, COUNTS),
    EyeEdge(12, Eye.OUTFEED, False),
    SampleBlock(20, 20, COUNTS),
]


def test_events_are_sorted_by_stamp_with_an_edge_before_the_block_of_its_stamp():
    assert list(Recording.from_events(CELL, reversed(EVENTS))) == EVENTS


def test_the_order_of_arrival_does_not_matter():
    random = Random(1)
    for _ in range(20):
        assert list(Recording.from_events(CELL, random.sample(EVENTS, len(EVENTS)))) == EVENTS
