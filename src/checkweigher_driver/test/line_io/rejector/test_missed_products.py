# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A missed product keeps the line stopped until a person can have read of it."""

import pytest

from checkweigher_core.records import StopRequest
from checkweigher_core.records.reasons import StopReason
from checkweigher_driver.line_io.rejector.missed_products import MissedProducts
from checkweigher_driver.line_io.rejector.run_permission import RunPermission

SHOW, FORGET, RUN, RESET = 'show', 'forget', 'run', 'reset'
ALL = 'item 1; item 2; item 3; and others'


def after(*events: str) -> MissedProducts:
    missed = MissedProducts()
    permission = RunPermission(missed)
    for event in events:
        match event:
            case 'show':
                permission.take_request(StopRequest(StopReason.DRIVER_TROUBLE, 0, 0, missed.text))
            case 'forget':
                permission.take_request(StopRequest(StopReason.NOT_READY, 0))
            case 'run':
                permission.take_request(None)
            case 'reset':
                missed.clear()
            case _:
                missed.add(event)
    return missed


@pytest.mark.parametrize(
    ('events', 'text', 'pending'),
    [
        ((), '', False),
        ((SHOW, RUN, FORGET, RESET), '', False),
        (('item 1',), 'item 1', True),
        (('item 1', RUN), 'item 1', True),  # the request had another reason
        (('item 1', SHOW), 'item 1', False),
        (('item 1', SHOW, RUN), '', False),
        (('item 1', RESET), '', False),
        (('item 1', SHOW, RESET), '', False),
        (('item 1', SHOW, FORGET, RUN), 'item 1', True),
        (('item 1', SHOW, 'item 2'), 'item 1; item 2', True),
        (('item 1', SHOW, 'item 2', RUN), 'item 1; item 2', True),
        (('item 1', SHOW, 'item 1'), 'item 1', False),
        (('item 1', 'item 2', 'item 3', 'item 4'), ALL, True),
        (('item 1', 'item 2', 'item 3', SHOW, 'item 4', RUN), ALL, True),
    ],
)
def test_the_line_stops_until_a_shown_message_is_reset(events, text, pending):
    missed = after(*events)
    assert (missed.text, missed.pending, missed.stop(0)) == (text, pending, bool(text))
