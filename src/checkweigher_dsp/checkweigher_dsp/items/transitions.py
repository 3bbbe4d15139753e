# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Transition table of item tracking, with the meaning of each edge and the next state of its item.

`TRANSITIONS` lists the cases of each kind of edge. The cases are tried in order, and the first case
that holds is applied. The reasons of a case are the faults that its action may add to items; see
docs/reasons.md.
"""

from collections.abc import Callable
from dataclasses import dataclass

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.belt import Belt
from checkweigher_dsp.items.departures import (
    departure_before,
    is_next_departure,
    is_none_due,
    take_leaving,
)
from checkweigher_dsp.items.eyes import Switch
from checkweigher_dsp.items.item import YET_TO_LEAVE, State, TrackedItem

_FLICKERS = 2  # longest chatter of an eye at the end of an item, in debounce times


@dataclass(frozen=True, slots=True)
class Transition:
    """Case of the transition table.

    If the case holds, the function `action` applies the edge, and returns the item that the edge
    belongs to, or True if the edge belongs to no known item. If the case does not hold, `action`
    returns None or False.
    """

    action: Callable[[Belt, Switch], TrackedItem | bool | None]
    state: State | None = None  # next state of the item, or None if it stays the same
    reasons: tuple[Reason, ...] = ()  # faults that the action may add


def apply_edge(belt: Belt, edge: EyeEdge) -> None:
    """Apply an edge that is the youngest of its eye."""
    infeed = edge.eye == Eye.INFEED
    there = belt.at_infeed if infeed else belt.at_outfeed
    switch = Switch(edge.stamp, belt.eyes.take(edge), there, edge.blocked)
    settle_first(belt)
    if not infeed:
        _merge_flicker(belt)
    if not edge.blocked:
        belt.clear(edge)
    for case in TRANSITIONS[edge.eye, edge.blocked]:
        item = case.action(belt, switch)
        if isinstance(item, TrackedItem) and case.state is not None:
            belt.move(item, case.state)
        if item:
            break
    if infeed:
        belt.clock_is_new = False


def settle_first(belt: Belt) -> None:
    """Add the item whose clearing edge was the first edge of the infeed eye.

    No item is added if ``belt.cleared_first`` is None, or if the edge only shows the initial state
    of the eye.
    """
    stamp, belt.cleared_first = belt.cleared_first, None
    if stamp is not None and not belt.eyes.shows_state(stamp):
        _put_unseen(belt, stamp, Reason.START_UP)


def _put_unseen(belt: Belt, stamp: int, reason: Reason) -> TrackedItem:
    """Add an item that was first seen when it cleared the infeed eye at `stamp` in ns."""
    item = belt.new_item()
    item.t2 = stamp
    item.fault(reason)
    belt.put(item)
    return item


def settle(belt: Belt, stamp: int) -> list[TrackedItem]:
    """Return the items whose numbers can no longer change after `stamp` in ns.

    A number changes if the newest item turns out to be a flicker of the eye at the end of the
    previous item. A flicker blocks the infeed eye for less than two debounce times. A flicker can
    continue only within two debounce times after the infeed eye has cleared.
    """
    settled = []
    while belt.unsettled and _is_settled(belt, belt.unsettled[0], stamp):
        item = belt.unsettled[0]
        if item in belt.items[-1:]:
            _merge_flicker(belt)
        if item in belt.unsettled:
            settled.append(belt.unsettled.popleft())
    return settled


def _is_settled(belt: Belt, item: TrackedItem, stamp: int) -> bool:
    if item.item_id < belt.count or item.t1 is None or item.state not in YET_TO_LEAVE:
        return True
    longest = _FLICKERS * belt.eyes.debounce
    begin = item.t1 if item.t2 is None or item.length >= longest else item.t2
    return stamp - begin >= longest


def _merge_flicker(belt: Belt) -> None:
    """Merge the newest item into the previous item if the newest item is a flicker of the eye.

    The newest item is a flicker if the clearing edge of the previous item was lost, and if the
    newest item blocked the infeed eye for less than the debounce time. If the newest item has the
    fault CHATTERING_EYE, less than twice the debounce time is sufficient.
    """
    others = [*belt.given_up, *belt.items[:-1]]
    if not belt.items or not others or belt.items[-1].item_id != belt.count:
        return
    before, item = others[-1], belt.items[-1]
    if item not in belt.unsettled or before.t1 is None or before.t2 is not None:
        return
    if 0 < item.length < _longest_flicker(belt, item):
        before.t2 = belt.remove_newest().t2
        before.fault(Reason.CHATTERING_EYE)
        belt.entered_last = belt.begun = before


def _longest_flicker(belt: Belt, item: TrackedItem) -> int:
    return belt.eyes.debounce * (_FLICKERS if Reason.CHATTERING_EYE in item.faults else 1)


# Cases that several kinds of edges share


def _show_state(belt: Belt, switch: Switch) -> bool:
    """Ignore the first edge of an eye if it only shows the initial state of the eye."""
    return switch.previous is None and belt.eyes.shows_state(switch.stamp)


def _last_at_outfeed(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Return the last item that began to leave if it may still be at the outfeed eye, or None."""
    last = belt.left_last
    if last is None:
        return None
    span = _longest_departure(belt, last, switch.stamp)
    covers = last.t3 is not None and 0 <= switch.stamp - last.t3 < span
    return last if covers or belt.eyes.flickers(switch) else None


def _longest_departure(belt: Belt, item: TrackedItem, stamp: int) -> int:
    """Return the longest time in ns for which an item can be at the outfeed eye.

    `stamp` is the time in ns of the edge that may belong to this item.
    """
    known = not item.outlier and not set(item.faults) - {Reason.DISTANCE_FAULT}
    span = max(item.length if known else 0, belt.eyes.debounce)
    if item is belt.at_outfeed and is_none_due(belt, stamp):
        # No other item can have reached the outfeed eye. So this item blocks the eye again, and its
        # clearing edge was lost.
        span = max(span, 2 * item.length or belt.transit.value or 0)
    return span


# Cases of an edge at which the infeed eye becomes blocked


def _reopen_entry(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Continue the entry of the last item if the eye flickers."""
    item = belt.entered_last if belt.entered_last is not None else belt.begun
    if item is None or not belt.eyes.flickers(switch):
        return None
    if item.t1 is not None:
        item.t2 = None
    item.fault(Reason.CHATTERING_EYE)
    return item


def _enter(belt: Belt, switch: Switch) -> TrackedItem:
    _merge_flicker(belt)
    if belt.at_infeed is not None:
        belt.at_infeed.fault(Reason.MISSING_EDGE)
        belt.move(belt.at_infeed, State.ON_BELT)
    belt.give_up_overdue(switch.stamp)
    belt.give_up_unloaded(switch.stamp)
    item = belt.begun = belt.new_item()
    item.t1 = switch.stamp
    item.others_there = belt.at_outfeed is not None or belt.covered
    item.left_before = departure_before(belt, switch.stamp)
    belt.put(item)
    return item


# Cases of an edge at which the infeed eye becomes clear


def _end_entry(belt: Belt, switch: Switch) -> TrackedItem | None:
    item = switch.there
    if item is None or item.t4 is not None:
        return None
    item.t2 = switch.stamp
    return item


def _keep_first(belt: Belt, switch: Switch) -> bool:
    """Keep the first edge of the eye until the next edge comes; see `settle_first`."""
    if switch.previous is not None:
        return False
    belt.cleared_first = switch.stamp
    return True


def _extend_entry(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Move t2 of the last item to this edge if the eye has flickered."""
    item = belt.entered_last
    if item is None or item.t2 is None:
        return None
    began = item.state in YET_TO_LEAVE and 0 < item.length < _longest_flicker(belt, item)
    if not began and not belt.eyes.flickers(switch):
        return None
    item.fault(Reason.CHATTERING_EYE)
    item.t2 = switch.stamp
    return item


def _end_reported(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Set t2 of an item that was already reported."""
    blocked = switch.previous is not None and switch.previous.blocked
    item = belt.begun if blocked or belt.clock_is_new else None
    if item is None or item.t2 is not None:
        return None
    if item.t4 is not None and item.t4 <= switch.stamp:
        return None
    item.t2 = switch.stamp
    return item


def _enter_unseen(belt: Belt, switch: Switch) -> TrackedItem:
    """Add an item whose blocking edge was lost."""
    belt.give_up_overdue(switch.stamp)
    return _put_unseen(belt, switch.stamp, Reason.MISSING_EDGE)


# Cases of an edge at which the outfeed eye becomes blocked


def _cover(belt: Belt, switch: Switch) -> bool:
    """Mark the outfeed eye as blocked by an unknown item if the eye flickers.

    The eye is not marked if a known item has left.
    """
    if belt.left_last is not None or not belt.eyes.flickers(switch):
        return False
    belt.covered = True
    return True


def _leave_again(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Continue the departure of the last item if it is still at the eye."""
    if item := _last_at_outfeed(belt, switch):
        item.t4 = None
    return item


def _leave_again_beside(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Continue the departure of an item if the only other item on the belt is entering.

    The fault MISSING_EDGE is added to the item that enters.
    """
    item = switch.there
    if item is None or not belt.only_entering:
        return None
    belt.items[0].fault(Reason.MISSING_EDGE)
    item.t4 = None
    return item


def _leave_late(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Begin the departure of a given-up or abandoned item if no item on the belt can leave yet."""
    on_belt = belt.items and not belt.only_entering
    gone = belt.given_up if belt.given_up or on_belt else belt.abandoned
    if not gone or not is_none_due(belt, switch.stamp):
        return None
    item = gone.popleft()
    item.t3, item.t4, item.outlier = switch.stamp, None, True
    belt.fault_all(Reason.DISTANCE_FAULT)  # The late item was on the belt with the other items.
    return item


def _leave(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Begin the departure of the item that is due to leave."""
    if not belt.items:
        return None
    ambiguous = belt.drop_given_up()
    return _begin_to_leave(belt, switch, take_leaving(belt, switch.stamp), ambiguous)


def _leave_unseen(belt: Belt, switch: Switch) -> TrackedItem:
    """Add an item whose infeed edges were lost."""
    ambiguous = belt.drop_given_up()
    item = belt.new_item()
    item.fault(Reason.MISSING_EDGE)
    return _begin_to_leave(belt, switch, item, ambiguous)


def _begin_to_leave(belt: Belt, switch: Switch, item: TrackedItem, ambiguous: bool) -> TrackedItem:
    item.t3 = switch.stamp
    item.usual_transit = belt.transit.value
    if ambiguous and belt.transit.of(item) is None:
        item.fault(Reason.DISTANCE_FAULT)  # The leaving item may be one that was given up.
    if item is belt.at_infeed:
        # The item is longer than the belt, or its clearing edge at the infeed eye was lost.
        item.fault(Reason.PRODUCT_TOO_LONG, Reason.MISSING_EDGE)
    before = belt.left_last
    if item.t2 is not None and before is not None and before.departure > item.t2:
        item.fault(Reason.DISTANCE_FAULT)
    if item.t1 is not None and item.t1 < switch.stamp and not item.faults:
        belt.transit.learn(item, switch.stamp - item.t1)
    belt.finished.append(item)
    return item


# Cases of an edge at which the outfeed eye becomes clear


def _go(belt: Belt, switch: Switch) -> TrackedItem | None:
    item = None if is_next_departure(belt, switch.stamp) else switch.there
    if item is not None:
        item.t4 = switch.stamp
    return item


def _uncover(belt: Belt, switch: Switch) -> bool:
    """Mark the eye as clear if the edge only shows the initial state or an unknown item left."""
    return (_show_state(belt, switch) or belt.covered) and _free(belt, switch)


def _go_again(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Move t4 of the last item to this edge if the item was still at the eye."""
    if item := _last_at_outfeed(belt, switch):
        belt.freed = item.t4 = switch.stamp
    return item


def _go_beside(belt: Belt, switch: Switch) -> bool:
    """Store the departure of an unknown item if the only item on the belt is entering.

    The fault DISTANCE_FAULT is added to the item that enters.
    """
    if not belt.only_entering:
        return False
    _go_before_start(belt, switch)
    belt.items[0].fault(Reason.DISTANCE_FAULT)
    return True


def _go_unseen(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Report the departure of an item whose blocking edge at the outfeed eye is missing."""
    if not belt.items:
        return None
    _go_before_start(belt, switch)
    item = belt.left_last = take_leaving(belt, switch.stamp)
    item.fault(Reason.MISSING_EDGE)
    item.t4 = switch.stamp
    belt.finished.append(item)
    return item


def _go_before_start(belt: Belt, switch: Switch) -> None:
    belt.freed = switch.stamp
    if switch.previous is None:
        belt.fault_all(Reason.START_UP)  # An item that entered before the start has left.


def _free(belt: Belt, switch: Switch) -> bool:
    """Store the departure of an item that is unknown or entered before the clock changed."""
    belt.freed = switch.stamp
    belt.covered = False
    return True


_MISSING, _DISTANCE = Reason.MISSING_EDGE, Reason.DISTANCE_FAULT
_CHATTER, _TOO_LONG, _START_UP = Reason.CHATTERING_EYE, Reason.PRODUCT_TOO_LONG, Reason.START_UP

TRANSITIONS: dict[tuple[Eye, bool], tuple[Transition, ...]] = {
    (Eye.INFEED, True): (
        Transition(_reopen_entry, State.ENTERING, (_CHATTER,)),
        Transition(_enter, State.ENTERING, (_CHATTER, _MISSING, _DISTANCE)),
    ),
    (Eye.INFEED, False): (
        Transition(_end_entry, State.ON_BELT),
        Transition(_show_state),
        Transition(_keep_first),
        Transition(_extend_entry, State.ON_BELT, (_CHATTER,)),
        Transition(_end_reported),
        Transition(_enter_unseen, State.ON_BELT, (_MISSING, _DISTANCE)),
    ),
    (Eye.OUTFEED, True): (
        Transition(_cover),
        Transition(_leave_again, State.LEAVING),
        Transition(_leave_again_beside, State.LEAVING, (_MISSING,)),
        Transition(_leave_late, State.LEAVING, (_DISTANCE,)),
        Transition(_leave, State.LEAVING, (_DISTANCE, _TOO_LONG, _MISSING)),
        Transition(_leave_unseen, State.LEAVING, (_MISSING, _DISTANCE)),
    ),
    (Eye.OUTFEED, False): (
        Transition(_go, State.GONE),
        Transition(_uncover),
        Transition(_go_again, State.GONE),
        Transition(_go_beside, None, (_START_UP, _DISTANCE)),
        Transition(_go_unseen, State.GIVEN_UP, (_START_UP, _MISSING)),
        Transition(_free),
    ),
}


# Late edges, which arrive after an edge with a later time stamp


def apply_late_edge(belt: Belt, edge: EyeEdge) -> None:
    """Apply a late edge, and add a fault to all items on the belt.

    The edge is assigned to a known item that lacks it. An edge that belongs to no known item may
    begin a new item. An edge that is chatter is not assigned.
    """
    settle_first(belt)
    belt.fault_all(Reason.LATE_EDGE)
    youngest, latest = belt.eyes.youngest.get(edge.eye), belt.eyes.latest.get(edge.eye)
    belt.eyes.latest[edge.eye] = edge
    if belt.eyes.flickers(Switch(edge.stamp, latest, None, edge.blocked)):
        return
    if edge.eye == Eye.INFEED and _complete_entry(belt, edge, youngest):
        return
    if youngest is None or edge.stamp >= youngest.stamp:
        apply_edge(belt, edge)
        belt.fault_all(Reason.LATE_EDGE)
    elif edge.eye == Eye.OUTFEED:
        _complete_departure(belt, edge)
    elif edge.blocked:
        item = belt.begun = belt.new_item()
        item.t1 = item.given_up = edge.stamp
        item.fault(Reason.LATE_EDGE)
        belt.finished.append(item)
        belt.move(item, State.GIVEN_UP)


def _complete_entry(belt: Belt, edge: EyeEdge, youngest: EyeEdge | None) -> bool:
    """Add an edge of the infeed eye to its item. Returns whether the item is known."""
    last, debounce = belt.entered_last, belt.eyes.debounce
    if edge.blocked:
        item = next((each for each in belt.recent if each.accounts_for(edge.stamp, debounce)), None)
        if item is not None and item.t1 is None:
            item.t1 = edge.stamp
    elif last is not None and youngest is not None and last.t1 == youngest.stamp < edge.stamp:
        item = last
        item.t2, belt.at_infeed = edge.stamp, None
        belt.move(item, State.ON_BELT)
        belt.eyes.youngest[edge.eye] = edge
    else:
        item = next((each for each in belt.recent if _lacks_t2(each, edge.stamp)), None)
        if item is not None:
            item.t2 = edge.stamp
    return item is not None


def _lacks_t2(item: TrackedItem, stamp: int) -> bool:
    """Return whether an item with t3 but without t2 can have cleared the infeed eye at `stamp`."""
    began = item.t1 is None or item.t1 < stamp
    return item.t2 is None and item.t3 is not None and began and stamp < item.t3


def _lacks_t3(item: TrackedItem, stamp: int) -> bool:
    return item.t3 is None and item.t4 is not None and item.entered < stamp < item.t4


def _complete_departure(belt: Belt, edge: EyeEdge) -> None:
    """Add an edge of the outfeed eye to its item if the item is known."""
    item = belt.at_outfeed
    if edge.blocked:
        if left := next((each for each in belt.recent if _lacks_t3(each, edge.stamp)), None):
            left.t3 = edge.stamp
    elif item is not None and item.t3 is not None and item.t3 < edge.stamp:
        item.t4, belt.at_outfeed = edge.stamp, None
        belt.move(item, State.GONE)
