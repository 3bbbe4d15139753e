# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Departures from the belt: assignment of outfeed edges to items, and times of departures."""

import math

from checkweigher_dsp.items.belt import Belt
from checkweigher_dsp.items.item import TrackedItem


def departure_before(belt: Belt, stamp: int) -> int | None:
    """Return the departure time in ns of the item ahead of an item that enters at `stamp` in ns.

    The result is None if the departure time is unknown.
    """
    if belt.covered:
        return None
    if belt.at_outfeed is not None:
        return belt.at_outfeed.departure
    return last_departure(belt, stamp)


def last_departure(belt: Belt, stamp: int) -> int | None:
    """Return the earlier of the time of the last departure and `stamp`, both in ns.

    The result is None if no departure time is known.
    """
    items = *belt.given_up, belt.left_last
    departures = [belt.freed, *(item.departure for item in items if item is not None)]
    last = max((each for each in departures if each is not None), default=None)
    return None if last is None else min(last, stamp)


def is_next_departure(belt: Belt, stamp: int) -> bool:
    """Return whether the first item on the belt is expected to clear the outfeed eye at `stamp`.

    If the result is True, the edge at which this item blocked the outfeed eye was lost. `stamp` is
    in ns. The result is False if the belt is empty, or if the first item still blocks the infeed
    eye.
    """
    if not belt.items or belt.items[0] is belt.at_infeed:
        return False
    return belt.transit.ends(belt.items[0], stamp)


def is_none_due(belt: Belt, stamp: int) -> bool:
    """Return whether no item on the belt can have reached the outfeed eye at `stamp` in ns."""
    return all(
        _is_entering(belt, item, stamp) or belt.transit.is_early(item, stamp) for item in belt.items
    )


def take_leaving(belt: Belt, stamp: int) -> TrackedItem:
    """Remove and return the item that an outfeed edge belongs to, and give up the items before it.

    The edge at `stamp`, in ns, is assigned to the item whose transit up to this edge is nearest to
    its expected transit. An item that is still entering is considered only if it is the first item
    on the belt. If the expected transits of all considered items are unknown, the edge is assigned
    to the first item. The belt must not be empty.
    """
    deviations = {0: math.inf}
    for i, candidate in enumerate(belt.items):
        transit = belt.transit.of(candidate)
        if transit is not None and (not _is_entering(belt, candidate, stamp) or not i):
            deviations[i] = abs(stamp - candidate.entered - transit)
    position = min(deviations, key=lambda i: deviations[i])
    for passed_over in belt.items[:position]:
        belt.miss(passed_over, stamp)
    item = belt.items[position]
    del belt.items[: position + 1]
    return item


def _is_entering(belt: Belt, item: TrackedItem, stamp: int) -> bool:
    return item is belt.at_infeed or (item.t2 is not None and item.t2 > stamp)
