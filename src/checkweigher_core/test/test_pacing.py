# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of due times and flow control, with expected numbers that are computed by hand."""

import numpy as np
import pytest

from checkweigher_core.pacing import FlowControl, Pacer
from checkweigher_core.records import Eye, EyeEdge, Reference, SampleBlock

SECOND = 1_000_000_000  # ns
RATE = 100.0  # Hz


def _block(stamp, size):
    return SampleBlock(stamp, 0, np.zeros(size, np.int32))


def _may_send(flow):
    """Return whether a block of 10 samples may be sent."""
    return flow.may_send(_block(0, 10), RATE)


def _room(flow):
    """Send blocks of 10 samples until no block may be sent. Returns the number of samples sent."""
    number = 0
    while _may_send(flow):
        flow.sent(_block(0, 10))
        number += 10
    return number


@pytest.mark.parametrize(('rate', 'seconds'), [(0.5, 6.0), (1.0, 3.0), (2.0, 1.5), (0.0, 0.0)])
def test_signal_passes_at_the_chosen_rate_or_for_0_at_once(rate, seconds):
    pacer = Pacer(rate, RATE, start=20.0)

    assert pacer.due(EyeEdge(7 * SECOND, Eye.INFEED, True)) == 20.0
    assert pacer.due(EyeEdge(10 * SECOND, Eye.INFEED, False)) == 20.0 + seconds
    assert pacer.due(Reference(10 * SECOND, 0.1)) == 20.0 + seconds


def test_a_block_is_due_when_its_last_sample_has_been_taken():
    pacer = Pacer(2.0, RATE, start=20.0)

    # 50 samples are 0.5 s of signal.
    assert pacer.due(_block(7 * SECOND, 50)) == 20.25
    assert pacer.due(_block(7 * SECOND + SECOND // 2, 50)) == 20.5
    # An edge during the second block is due before the end of this block.
    assert pacer.due(EyeEdge(7 * SECOND + 3 * SECOND // 4, Eye.INFEED, True)) == 20.375


def _flow(samples=0, **limits):
    """Return the flow control of a driver that has sent `samples` samples."""
    flow = FlowControl(**limits)
    flow.sent(_block(0, samples))
    return flow


def _edge(seconds):
    return EyeEdge(round(seconds * SECOND), Eye.INFEED, True)


def test_the_lead_is_limited_in_time_and_in_blocks():
    # The lag of 1 s allows 100 samples, which is less than 500 blocks of 10 samples. One more block
    # is sent when the limit is just reached.
    flow = _flow()
    assert _room(flow) == 110
    flow.taken(10, 0, 0)
    assert _room(flow) == 10
    # 3 blocks of 10 samples are less than 100 samples, so the number of blocks is the limit.
    flow = _flow(max_blocks=3)
    assert _room(flow) == 40
    # A larger block also counts as one block in the queue: 3 blocks of 20 samples allow 60 samples.
    assert flow.may_send(_block(0, 20), RATE)


def test_the_lead_is_limited_in_items_without_a_verdict():
    flow = _flow(50, max_items=2)
    flow.taken(50, 0, 2)
    assert _may_send(flow)

    flow.taken(50, 0, 3)
    assert not _may_send(flow)

    flow.items_judged += 1
    assert _may_send(flow)


def test_samples_wait_for_an_edge_that_they_would_leave_behind():
    flow = _flow()
    flow.sent(_edge(7.0))
    flow.sent(_edge(7.5))
    block = _block(8 * SECOND, 10)  # ends at 8.1 s, 1.1 s after the first edge
    assert flow.awaits_edges(block, RATE)
    assert not flow.may_send(block, RATE)
    assert flow.may_send(_block(7 * SECOND, 90), RATE)
    assert flow.may_send(_edge(9.0), RATE)

    flow.taken(0, 1, 0)
    assert flow.may_send(block, RATE)
    later = _block(8 * SECOND, 55)
    assert not flow.may_send(later, RATE)
    # The segmenter may report more edges than were sent, because other nodes may send edges, too.
    flow.taken(0, 5, 0)
    assert flow.may_send(later, RATE)


def test_edges_wait_for_room_in_the_queue():
    flow = _flow(max_edges=3)
    for _ in range(3):
        assert flow.may_send(_edge(7.0), RATE)
        flow.sent(_edge(7.0))
    assert flow.awaits_edges(_edge(7.0), RATE)
    assert not flow.may_send(_edge(7.0), RATE)
    assert flow.may_send(_block(7 * SECOND, 10), RATE)

    flow.taken(0, 1, 0)
    assert flow.may_send(_edge(7.0), RATE)


def test_edges_are_given_up_only_when_they_alone_are_missing():
    flow = _flow(50)
    flow.sent(_edge(1.0))
    flow.sent(_edge(1.5))
    assert flow.give_up_edges() == 0

    flow.taken(50, 0, 0)
    block = _block(7 * SECOND, 10)
    assert not flow.may_send(block, RATE)
    assert flow.give_up_edges() == 2
    assert flow.may_send(block, RATE)

    # Later edges are counted as before.
    flow.sent(_edge(4.0))
    assert not flow.may_send(block, RATE)
    flow.taken(50, 1, 0)
    assert flow.may_send(block, RATE)


def test_a_new_segmenter_begins_with_what_comes_then():
    flow = _flow(500, max_items=2)
    flow.sent(_edge(3.0))
    flow.sent(_edge(3.5))
    flow.taken(450, 1, 7)
    flow.items_judged += 1
    assert not _may_send(flow)

    # The 500 samples and 2 edges were sent to the old segmenter. Its items without a verdict will
    # never get one.
    flow.taken(0, 0, 0)
    assert flow.items_judged == 0
    assert _may_send(flow)
    assert flow.may_send(_block(7 * SECOND, 10), RATE)

    assert _room(flow) == 110
    flow.taken(10, 0, 1)
    assert _may_send(flow)

    flow.sent(_edge(5.0))
    assert not flow.may_send(_block(7 * SECOND, 10), RATE)
    flow.taken(10, 1, 1)
    assert flow.may_send(_block(7 * SECOND, 10), RATE)


def test_a_new_segmenter_may_be_heard_late():
    # The first message of the new segmenter reports 40 samples. It may have missed all others of
    # the 500 samples.
    flow = _flow(500)
    flow.taken(450, 0, 7)
    flow.taken(40, 0, 2)

    assert flow.items_judged == 2
    assert _room(flow) == 110
    flow.taken(0, 0, 0)  # the segmenter is restarted again
    assert _room(flow) == 110
