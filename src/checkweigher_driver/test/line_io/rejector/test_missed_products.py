# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A missed product keeps the line stopped until a person can have read of it."""

import pytest

from checkweigher_driver.line_io.rejector.missed_products import Latch, LatchEvent, MissedProducts

SHOW, FORGET, RUN, RESET = LatchEvent.SHOW, LatchEvent.FORGET, LatchEvent.RUN, LatchEvent.RESET
ALL = 'item 1; item 2; item 3; and others'


def after(*events):
    missed = MissedProducts()
    for event in events:
        if isinstance(event, LatchEvent):
            missed.take(event)
        else:
            missed.add(event)
    return missed


@pytest.mark.parametrize(
    ('events', 'state', 'text'),
    [
        ((), Latch.CLEAR, ''),
        ((SHOW, RUN, FORGET, RESET), Latch.CLEAR, ''),
        (('item 1',), Latch.PENDING, 'item 1'),
        (('item 1', RUN), Latch.PENDING, 'item 1'),  # the request had another reason
        (('item 1', SHOW), Latch.SHOWN, 'item 1'),
        (('item 1', SHOW, RUN), Latch.CLEAR, ''),
        (('item 1', RESET), Latch.CLEAR, ''),
        (('item 1', SHOW, RESET), Latch.CLEAR, ''),
        (('item 1', SHOW, FORGET, RUN), Latch.PENDING, 'item 1'),
        (('item 1', SHOW, 'item 2'), Latch.PENDING, 'item 1; item 2'),
        (('item 1', SHOW, 'item 2', RUN), Latch.PENDING, 'item 1; item 2'),
        (('item 1', SHOW, 'item 1'), Latch.SHOWN, 'item 1'),
        (('item 1', 'item 2', 'item 3', 'item 4'), Latch.PENDING, ALL),
        (('item 1', 'item 2', 'item 3', SHOW, 'item 4', RUN), Latch.PENDING, ALL),
    ],
)
def test_the_latch_follows_its_table(events, state, text):
    missed = after(*events)
    assert (missed.state, missed.text) == (state, text)
