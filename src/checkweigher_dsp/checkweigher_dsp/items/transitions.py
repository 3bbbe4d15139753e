# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The transition table of item tracking: what each edge means and where it moves which item.

For each kind of edge `TRANSITIONS` lists the cases in the order in which they are tried; the first
one that holds is taken. The reasons are those of docs/reasons.md that a case may give to its
item or to others on the belt.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.belt import Belt
from checkweigher_dsp.items.eyes import Switch
from checkweigher_dsp.items.item import YET_TO_LEAVE, State, TrackedItem

_FLICKERS = 2  # debounce times, for which an eye may chatter where an item ends


@dataclass(frozen=True, slots=True)
class Transition:
    """One case of an edge."""

    # Returns the item that the edge is of; or, where it is of none that is known, whether the case
    # holds.
    guard: Callable[[Belt, Switch], TrackedItem | bool | None]
    # Takes what the guard returned, notes what the edge shows, returns the item.
    action: Callable[[Belt, Switch, Any], TrackedItem | None]
    state: State | None = None  # of the item from now on
    reasons: tuple[Reason, ...] = ()  # why it, or others on the belt, may not be weighed for it


def apply_edge(belt: Belt, edge: EyeEdge) -> None:
    """Take an edge that is the youngest of its eye."""
    stamp, blocked, infeed = edge.stamp, edge.blocked, edge.eye == Eye.INFEED
    there = belt.at_infeed if infeed else belt.at_outfeed
    switch = Switch(stamp, belt.eyes.take(edge), there, blocked)
    settle_first(belt)
    if not infeed:
        _merge_flicker(belt)
    if not blocked:
        if infeed:
            belt.at_infeed = None
        else:
            belt.clear_outfeed(stamp)
    for case in TRANSITIONS[edge.eye, blocked]:
        found = case.guard(belt, switch)
        if found:
            item = case.action(belt, switch, found)
            if item is not None and case.state is not None:
                belt.move(item, case.state)
            break
    if infeed:
        belt.clock_is_new = False


def settle_first(belt: Belt) -> None:
    """Take the item that the infeed eye saw first of all, unless the eye showed its state."""
    stamp, belt.cleared_first = belt.cleared_first, None
    if stamp is not None and not belt.eyes.shows_state(stamp):
        _put_unseen(belt, stamp, Reason.START_UP)


def _put_unseen(belt: Belt, stamp: int, reason: Reason) -> TrackedItem:
    """Put an item on the belt whose t2 alone the infeed eye showed."""
    item = belt.new_item()
    item.t2 = stamp
    item.fault(reason)
    belt.put(item)
    return item


def settle(belt: Belt, stamp: int) -> list[TrackedItem]:
    """Return the items whose numbers can no longer change at `stamp`, ns: none is taken back.

    Only the newest item can turn out to be a flicker of the one before, and only if it has blocked
    the infeed eye for less than two debounce times. Two more after that no flicker follows.
    """
    settled = []
    while (item := belt.next_to_settle()) is not None and _is_settled(belt, item, stamp):
        if item in belt.items[-1:]:
            _merge_flicker(belt)
        if item is belt.next_to_settle():
            settled.append(belt.settle_next())
    return settled


def _is_settled(belt: Belt, item: TrackedItem, stamp: int) -> bool:
    if item.item_id < belt.count or item.t1 is None or item.state not in YET_TO_LEAVE:
        return True
    longest = _FLICKERS * belt.eyes.debounce
    begin = item.t1 if item.t2 is None or item.length >= longest else item.t2
    return stamp - begin >= longest


def _merge_flicker(belt: Belt) -> None:
    """Take a pulse too short for an item as the end of the item before, which lost its t2."""
    others = [*belt.given_up, *belt.items[:-1]]
    if not belt.items or not others or belt.items[-1].item_id != belt.count:
        return
    before, item = others[-1], belt.items[-1]
    if item.settled:
        return
    if before.t1 is None or before.t2 is not None or not item.length:
        return
    if item.length < _longest_flicker(belt, item):
        before.t2 = belt.remove_newest().t2
        before.fault(Reason.CHATTERING_EYE)
        belt.entered_last = belt.begun = before


def _longest_flicker(belt: Belt, item: TrackedItem) -> int:
    return belt.eyes.debounce * (_FLICKERS if Reason.CHATTERING_EYE in item.faults else 1)


# Cases of several edges.


def _otherwise(belt: Belt, switch: Switch) -> bool:
    return True


def _shows_state(belt: Belt, switch: Switch) -> bool:
    return switch.previous is None and belt.eyes.shows_state(switch.stamp)


def _last_at_outfeed(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Return the item that left last if it must still be in front of the outfeed eye."""
    last = belt.left_last
    if last is None:
        return None
    known = not last.outlier and not set(last.faults) - {Reason.DISTANCE_FAULT}
    span = max(last.length if known else 0, belt.eyes.debounce)
    if last is belt.at_outfeed and belt.is_none_due(switch.stamp):
        span = max(span, 2 * last.length or belt.transit.value or 0)  # its t4 was lost
    covers = last.t3 is not None and 0 <= switch.stamp - last.t3 < span
    return last if covers or belt.eyes.flickers(switch) else None


def _any_on_belt(belt: Belt, switch: Switch) -> bool:
    return bool(belt.items)


def _ignore(belt: Belt, switch: Switch, _: bool) -> None:
    """Pass over an edge that shows nothing new."""


def _set_t2(belt: Belt, switch: Switch, item: TrackedItem) -> TrackedItem:
    item.t2 = switch.stamp
    return item


# The infeed eye is blocked.


def _flickering_entry(belt: Belt, switch: Switch) -> TrackedItem | None:
    last = belt.entered_last if belt.entered_last is not None else belt.begun
    return last if belt.eyes.flickers(switch) else None


def _reopen_entry(belt: Belt, switch: Switch, item: TrackedItem) -> TrackedItem:
    if item.t1 is not None:
        item.t2 = None
    item.fault(Reason.CHATTERING_EYE)
    return item


def _enter(belt: Belt, switch: Switch, _: bool) -> TrackedItem:
    _merge_flicker(belt)
    if belt.at_infeed is not None:
        belt.at_infeed.fault(Reason.MISSING_EDGE)
        belt.move(belt.at_infeed, State.ON_BELT)
    belt.give_up_overdue(switch.stamp)
    belt.give_up_unloaded(switch.stamp)
    item = belt.begun = belt.new_item()
    item.t1 = switch.stamp
    item.others_there = belt.at_outfeed is not None or belt.covered
    item.left_before = belt.departure_before(switch.stamp)
    belt.put(item)
    return item


# The infeed eye clears.


def _entering(belt: Belt, switch: Switch) -> TrackedItem | None:
    item = switch.there
    return item if item is not None and item.t4 is None else None


def _is_first(belt: Belt, switch: Switch) -> bool:
    return switch.previous is None


def _keep_first(belt: Belt, switch: Switch, _: bool) -> None:
    """Wait for the other eye: with its edge `settle_first` knows whether this is an item."""
    belt.cleared_first = switch.stamp


def _flickering_after_entry(belt: Belt, switch: Switch) -> TrackedItem | None:
    last = belt.entered_last
    if last is None or last.t2 is None:
        return None
    began = last.state in YET_TO_LEAVE and 0 < last.length < _longest_flicker(belt, last)
    return last if began or belt.eyes.flickers(switch) else None


def _extend_entry(belt: Belt, switch: Switch, item: TrackedItem) -> TrackedItem:
    item.fault(Reason.CHATTERING_EYE)
    item.t2 = switch.stamp
    return item


def _reported(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Return the item at the infeed eye if it was reported before its t2."""
    blocked = switch.previous is not None and switch.previous.blocked
    item = belt.begun if blocked or belt.clock_is_new else None
    if item is None or item.t2 is not None:
        return None
    return item if item.t4 is None or item.t4 > switch.stamp else None


def _enter_unseen(belt: Belt, switch: Switch, _: bool) -> TrackedItem:
    belt.give_up_overdue(switch.stamp)
    return _put_unseen(belt, switch.stamp, Reason.MISSING_EDGE)


# The outfeed eye is blocked.


def _flickers_of_unknown(belt: Belt, switch: Switch) -> bool:
    return belt.left_last is None and belt.eyes.flickers(switch)


def _cover(belt: Belt, switch: Switch, _: bool) -> None:
    belt.covered = True


def _leave_again(belt: Belt, switch: Switch, item: TrackedItem) -> TrackedItem:
    item.t4 = None
    return item


def _leaving_without_t4(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Return the last item if no other can be there: what is at one eye is not at the other."""
    blocked = switch.previous is not None and switch.previous.blocked
    return switch.there if belt.only_entering and blocked else None


def _leave_again_beside(belt: Belt, switch: Switch, item: TrackedItem) -> TrackedItem:
    belt.items[0].fault(Reason.MISSING_EDGE)
    return _leave_again(belt, switch, item)


def _given_up_comes(belt: Belt, switch: Switch) -> TrackedItem | None:
    """Return the item that was given up if the eye sees that, and not what is on the belt."""
    on_belt = belt.items and not belt.only_entering
    gone = belt.given_up if belt.given_up or on_belt else belt.abandoned
    return gone[0] if gone and belt.is_none_due(switch.stamp) else None


def _leave_late(belt: Belt, switch: Switch, item: TrackedItem) -> TrackedItem:
    (belt.given_up or belt.abandoned).popleft()
    item.t3, item.t4, item.outlier = switch.stamp, None, True
    belt.fault_all(Reason.DISTANCE_FAULT)  # it was there as well
    return item


def _leave(belt: Belt, switch: Switch, _: bool) -> TrackedItem:
    ambiguous = belt.drop_given_up()
    return _begin_to_leave(belt, switch, belt.take_leaving(switch.stamp), ambiguous)


def _leave_unseen(belt: Belt, switch: Switch, _: bool) -> TrackedItem:
    ambiguous = belt.drop_given_up()
    item = belt.new_item()
    item.fault(Reason.MISSING_EDGE)
    return _begin_to_leave(belt, switch, item, ambiguous)


def _begin_to_leave(belt: Belt, switch: Switch, item: TrackedItem, ambiguous: bool) -> TrackedItem:
    item.t3 = switch.stamp
    item.usual_transit = belt.transit.value
    if ambiguous and belt.transit.of(item) is None:
        item.fault(Reason.DISTANCE_FAULT)  # nothing shows which of them it is
    if item is belt.at_infeed:
        # Too long to be on the belt as a whole, or its edge was lost: t2 shows which, if it comes.
        item.fault(Reason.PRODUCT_TOO_LONG, Reason.MISSING_EDGE)
    before = belt.left_last
    if item.t2 is not None and before is not None and before.departure > item.t2:
        item.fault(Reason.DISTANCE_FAULT)
    if item.t1 is not None and item.t1 < switch.stamp and not item.faults:
        belt.transit.learn(item, switch.stamp - item.t1)
    belt.finish(item)
    return item


# The outfeed eye clears.


def _leaving(belt: Belt, switch: Switch) -> TrackedItem | None:
    return None if belt.is_next_departure(switch.stamp) else switch.there


def _go(belt: Belt, switch: Switch, item: TrackedItem) -> TrackedItem:
    item.t4 = switch.stamp
    return item


def _free(belt: Belt, switch: Switch, _: bool) -> None:
    """Note that something is gone that no eye has seen, or that came by another clock."""
    belt.freed = switch.stamp
    belt.covered = False


def _is_covered(belt: Belt, switch: Switch) -> bool:
    return belt.covered


def _go_again(belt: Belt, switch: Switch, item: TrackedItem) -> TrackedItem:
    belt.freed = item.t4 = switch.stamp
    return item


def _only_entering(belt: Belt, switch: Switch) -> bool:
    return belt.only_entering


def _go_beside(belt: Belt, switch: Switch, _: bool) -> None:
    """Note that another item than the one that enters has left."""
    _note_unseen(belt, switch)
    belt.items[0].fault(Reason.DISTANCE_FAULT)


def _go_unseen(belt: Belt, switch: Switch, _: bool) -> TrackedItem:
    """Report the item that left without its t3; if another one has left, it may yet come."""
    _note_unseen(belt, switch)
    item = belt.left_last = belt.take_leaving(switch.stamp)
    item.fault(Reason.MISSING_EDGE)
    item.t4 = switch.stamp
    belt.finish(item)
    return item


def _note_unseen(belt: Belt, switch: Switch) -> None:
    belt.freed = switch.stamp
    if switch.previous is None:
        belt.fault_all(Reason.START_UP)  # something left that nothing had seen


_Case, _S = Transition, State
_MISSING, _DISTANCE = Reason.MISSING_EDGE, Reason.DISTANCE_FAULT
_CHATTER, _TOO_LONG, _START_UP = Reason.CHATTERING_EYE, Reason.PRODUCT_TOO_LONG, Reason.START_UP

TRANSITIONS: dict[tuple[Eye, bool], tuple[Transition, ...]] = {
    (Eye.INFEED, True): (
        _Case(_flickering_entry, _reopen_entry, _S.ENTERING, (_CHATTER,)),
        _Case(_otherwise, _enter, _S.ENTERING, (_CHATTER, _MISSING, _DISTANCE)),
    ),
    (Eye.INFEED, False): (
        _Case(_entering, _set_t2, _S.ON_BELT),
        _Case(_shows_state, _ignore),
        _Case(_is_first, _keep_first),
        _Case(_flickering_after_entry, _extend_entry, _S.ON_BELT, (_CHATTER,)),
        _Case(_reported, _set_t2),
        _Case(_otherwise, _enter_unseen, _S.ON_BELT, (_MISSING, _DISTANCE)),
    ),
    (Eye.OUTFEED, True): (
        _Case(_flickers_of_unknown, _cover),
        _Case(_last_at_outfeed, _leave_again, _S.LEAVING),
        _Case(_leaving_without_t4, _leave_again_beside, _S.LEAVING, (_MISSING,)),
        _Case(_given_up_comes, _leave_late, _S.LEAVING, (_DISTANCE,)),
        _Case(_any_on_belt, _leave, _S.LEAVING, (_DISTANCE, _TOO_LONG, _MISSING)),
        _Case(_otherwise, _leave_unseen, _S.LEAVING, (_MISSING, _DISTANCE)),
    ),
    (Eye.OUTFEED, False): (
        _Case(_leaving, _go, _S.GONE),
        _Case(_shows_state, _free),
        _Case(_is_covered, _free),
        _Case(_last_at_outfeed, _go_again, _S.GONE),
        _Case(_only_entering, _go_beside, None, (_START_UP, _DISTANCE)),
        _Case(_any_on_belt, _go_unseen, _S.GIVEN_UP, (_START_UP, _MISSING)),
        _Case(_otherwise, _free),
    ),
}


# An edge comes after a younger one.


def apply_late_edge(belt: Belt, edge: EyeEdge) -> None:
    """Take an edge that comes after a younger one: no item on the belt can be trusted.

    It completes an item that lacks it; only what no item accounts for is a further one.
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
        belt.finish(item)
        belt.move(item, State.GIVEN_UP)


def _complete_entry(belt: Belt, edge: EyeEdge, youngest: EyeEdge | None) -> bool:
    """Note an edge of an item that has entered; tell whether it is one."""
    last = belt.entered_last
    if edge.blocked:
        item = belt.entered_at(edge.stamp)
        if item is not None and item.t1 is None:
            item.t1 = edge.stamp
    elif last is not None and youngest is not None and last.t1 == youngest.stamp < edge.stamp:
        item = last  # it may have left meanwhile
        item.t2, belt.at_infeed = edge.stamp, None
        belt.move(item, State.ON_BELT)
        belt.eyes.youngest[edge.eye] = edge
    else:
        item = belt.without_t2(edge.stamp)
        if item is not None:
            item.t2 = edge.stamp
    return item is not None


def _complete_departure(belt: Belt, edge: EyeEdge) -> None:
    """Note an edge of an item that has left, if it is one."""
    item = belt.at_outfeed
    if edge.blocked:
        belt.complete_t3(edge.stamp)
    elif item is not None and item.t3 is not None and item.t3 < edge.stamp:
        item.t4, belt.at_outfeed = edge.stamp, None
        belt.move(item, State.GONE)
