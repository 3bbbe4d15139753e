# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Item on the line, with its photo-eye edges and its state."""

from dataclasses import dataclass, field, replace
from enum import Enum

from checkweigher_core.records.reasons import Reason


class State(Enum):
    """Place of an item according to the photo-eyes."""

    ENTERING = 'the item blocks the infeed eye'
    ON_BELT = 'the item is between the eyes'
    LEAVING = 'the item is the last one that has blocked the outfeed eye'
    GONE = 'no further edge belongs to the item'
    GIVEN_UP = 'the item was reported without an outfeed edge, which may still come'
    ABANDONED = 'the stream has ended; an edge is assigned to this item only if no other item fits'


YET_TO_LEAVE = (State.ENTERING, State.ON_BELT)


@dataclass(slots=True, eq=False)
class TrackedItem:
    """Item on the line, with its edges.

    Times are in ns unless stated otherwise. A time is None while it is unknown.
    """

    item_id: int  # number of the item in the order of entry
    t1: int | None = None  # time at which the item begins to enter
    t2: int | None = None  # time at which the item is fully on the belt
    t3: int | None = None  # time at which the item begins to leave
    t4: int | None = None  # time at which the item has left.
    # Reasons why the item cannot be weighed, in the order of their detection. The reasons are the
    # keys of a dictionary, because a set would not keep their order.
    faults: dict[Reason, None] = field(default_factory=dict)
    # Time at which the previous item left, or None if it is unknown. If `others_there` is true, the
    # previous item may have left after t1.
    left_before: int | None = None
    others_there: bool = False  # whether another item may have been at the outfeed eye at t1
    usual_transit: int | None = None  # usual transit of earlier items when this item began to leave
    given_up: int | None = None  # time at which the item was given up.
    # Whether the transit is an outlier according to `UsualTransit.learn`, or the item began to
    # leave only after it was given up.
    outlier: bool = False
    state: State = State.ON_BELT
    # Shift in ns of the weigh window behind the edges, because the load lags behind the edges. The
    # shift is None before the rise of the load is compared with the edges.
    shift: int | None = None
    shift_std_dev: float = 0.0  # standard deviation of the shift in s

    @property
    def entered(self) -> int:
        """Time in ns of the first known edge, which is t1, t2 or t3."""
        return next(stamp for stamp in (self.t1, self.t2, self.t3) if stamp is not None)

    @property
    def edges(self) -> tuple[int, int, int] | None:
        """Times t1, t2 and t3 in ns, or None if one of these edges is missing."""
        if self.t1 is None or self.t2 is None or self.t3 is None:
            return None
        return self.t1, self.t2, self.t3

    @property
    def length(self) -> int:
        """Time t2 - t1 in ns for which the item blocks the infeed eye, or 0 if it is unknown."""
        return self.t2 - self.t1 if self.t1 is not None and self.t2 is not None else 0

    @property
    def departure(self) -> int:
        """Time in ns at which the item has left; if t4 is unknown, an upper limit of this time."""
        if self.t4 is not None:
            return self.t4
        if self.t3 is None and self.given_up is not None:
            # The item may have been on the belt until it was given up.
            return self.given_up if self.t2 is None else max(self.given_up, self.t2)
        return (self.entered if self.t3 is None else self.t3) + 2 * self.length

    def fault(self, *reasons: Reason) -> None:
        """Add reasons why the item cannot be weighed."""
        self.faults.update(dict.fromkeys(reasons))

    def accounts_for(self, stamp: int, debounce: int) -> bool:
        """Return whether the item can have blocked the infeed eye at the time `stamp`.

        `stamp` and the debounce time `debounce` of the eye are in ns. An item without t1 can have
        blocked the eye at any time before its first known edge.
        """
        if self.t1 is None:
            return stamp < self.entered
        if self.t2 is None and Reason.CHATTERING_EYE in self.faults:
            return self.t1 <= stamp
        return self.t1 <= stamp <= (self.t1 if self.t2 is None else self.t2) + debounce

    def snapshot(self) -> 'TrackedItem':
        """Return a copy, which later edges do not change."""
        return replace(self, faults=dict(self.faults))
