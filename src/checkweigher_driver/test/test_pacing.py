"""Due times and the lead of the driver, against numbers by hand."""

import numpy as np
import pytest

from checkweigher_driver.pacing import FlowControl, Pacer
from checkweigher_dsp.records import Eye, EyeEdge, Reference, SampleBlock

SECOND = 1_000_000_000  # ns
RATE = 100.0  # Hz


def _block(stamp, size):
    return SampleBlock(stamp, 0, np.zeros(size, np.int32))


def _may_send(flow):
    """Tell whether a block of 10 samples may follow."""
    return flow.may_send(_block(0, 10), RATE)


# --- Pacer -------------------------------------------------------------------------------------


@pytest.mark.parametrize(('rate', 'seconds'), [(0.5, 6.0), (1.0, 3.0), (2.0, 1.5)])
def test_signal_passes_at_the_chosen_rate(rate, seconds):
    pacer = Pacer(rate, RATE, start=20.0)

    assert pacer.due(EyeEdge(7 * SECOND, Eye.INFEED, True)) == 20.0
    assert pacer.due(EyeEdge(10 * SECOND, Eye.INFEED, False)) == 20.0 + seconds
    assert pacer.due(Reference(10 * SECOND, 0.1)) == 20.0 + seconds


def test_a_block_is_due_when_its_last_sample_has_been_taken():
    pacer = Pacer(2.0, RATE, start=20.0)

    # 50 samples are 0.5 s of signal.
    assert pacer.due(_block(7 * SECOND, 50)) == 20.25
    assert pacer.due(_block(7 * SECOND + SECOND // 2, 50)) == 20.5
    # An edge that fell while the second block was being sampled comes before it.
    assert pacer.due(EyeEdge(7 * SECOND + 3 * SECOND // 4, Eye.INFEED, True)) == 20.375


def test_at_rate_0_everything_is_due_at_once():
    pacer = Pacer(0.0, RATE, start=20.0)

    assert pacer.due(_block(7 * SECOND, 50)) == 20.0
    assert pacer.due(EyeEdge(3600 * SECOND, Eye.INFEED, True)) == 20.0


# --- FlowControl -------------------------------------------------------------------------------


def test_the_lead_is_limited_in_time():
    # 1 s is 100 samples, 500 blocks of 10 are more.
    flow = FlowControl(samples_sent=100)
    assert _may_send(flow)

    flow.samples_sent = 110
    assert not _may_send(flow)

    flow.taken(10, 0)
    assert _may_send(flow)


def test_the_lead_is_limited_in_blocks():
    # 3 blocks of 10 are less than 100 samples.
    flow = FlowControl(max_blocks=3, samples_sent=30)
    assert _may_send(flow)

    flow.samples_sent = 40
    assert not _may_send(flow)
    # Larger blocks take no more room in the queue: 3 of 20 are 60 samples.
    assert flow.may_send(_block(0, 20), RATE)


def test_the_lead_is_limited_in_items_without_a_verdict():
    flow = FlowControl(max_items=2, samples_sent=50)
    flow.taken(50, 2)
    assert _may_send(flow)

    flow.taken(50, 3)
    assert not _may_send(flow)

    flow.items_judged = 1
    assert _may_send(flow)


def test_a_new_segmenter_begins_with_what_comes_then():
    flow = FlowControl(max_items=2, samples_sent=500)
    flow.taken(450, 7)
    flow.items_judged = 4
    assert not _may_send(flow)

    # The 500 samples went to the old one, and nobody will judge its items 5 to 7.
    flow.taken(0, 0)
    assert (flow.samples_missed, flow.items_judged) == (500, 0)
    assert _may_send(flow)

    flow.samples_sent = 600
    assert _may_send(flow)
    flow.samples_sent = 610
    assert not _may_send(flow)
    flow.taken(10, 1)
    assert _may_send(flow)


def test_a_new_segmenter_may_be_heard_late():
    # Its first message to arrive says 40 samples: of 500 it can have missed all others.
    flow = FlowControl(samples_sent=500)
    flow.taken(450, 7)
    flow.taken(40, 2)

    assert (flow.samples_missed, flow.items_judged) == (460, 2)
    flow.samples_sent = 600
    assert _may_send(flow)
    flow.samples_sent = 610
    assert not _may_send(flow)


def test_the_segmenter_may_be_replaced_again():
    flow = FlowControl(samples_sent=500)
    flow.taken(450, 7)
    flow.taken(0, 0)
    flow.samples_sent = 600
    flow.taken(100, 1)
    assert flow.samples_missed == 500

    flow.taken(0, 0)
    assert flow.samples_missed == 600
    flow.samples_sent = 700
    assert _may_send(flow)
    flow.samples_sent = 710
    assert not _may_send(flow)
