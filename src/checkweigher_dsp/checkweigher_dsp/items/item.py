# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""One item on the line: its edges, and its state according to them."""

from dataclasses import dataclass, field, replace
from enum import Enum

from checkweigher_core.records.reasons import Reason


class State(Enum):
    """Place of an item according to the eyes."""

    ENTERING = 'it blocks the infeed eye'
    ON_BELT = 'it is between the eyes'
    LEAVING = 'it blocks the outfeed eye, or blocked it last'
    GONE = 'no eye will see it again'
    GIVEN_UP = 'it was reported without its t3; the outfeed eye may still see it'
    ABANDONED = 'as GIVEN_UP, but its stream has ended; an edge is its own only if no other fits'


YET_TO_LEAVE = (State.ENTERING, State.ON_BELT)


@dataclass(slots=True, eq=False)
class TrackedItem:
    """One item on the line, with its edges; all times in ns."""

    item_id: int  # in the order of entry
    t1: int | None = None  # begins to enter
    t2: int | None = None  # is fully on the belt
    t3: int | None = None  # begins to leave
    t4: int | None = None  # is gone
    # Reasons why it cannot be weighed: a set in the order in which they were found.
    faults: dict[Reason, None] = field(default_factory=dict)
    left_before: int | None = None  # departure of the previous item; after t1 if `others_there`
    others_there: bool = False  # whether another item may have been at the outfeed eye at t1
    usual_transit: int | None = None  # ns from eye to eye, of the last whole item ahead of it
    given_up: int | None = None  # time at which it was given up
    outlier: bool = False  # much slower or faster than earlier items, so its length may be wrong
    state: State = State.ON_BELT
    shift: int | None = None  # lag of the rise behind its edges; None until they are compared
    doubt: float = 0.0  # s, standard deviation of the shift

    @property
    def entered(self) -> int:
        """Time of its first edge, ns."""
        return next(stamp for stamp in (self.t1, self.t2, self.t3) if stamp is not None)

    @property
    def edges(self) -> tuple[int, int, int] | None:
        """t1, t2 and t3, None if one of them is missing."""
        if self.t1 is None or self.t2 is None or self.t3 is None:
            return None
        return self.t1, self.t2, self.t3

    @property
    def length(self) -> int:
        """Time for which it blocks an eye, ns; 0 if unknown."""
        return self.t2 - self.t1 if self.t1 is not None and self.t2 is not None else 0

    @property
    def departure(self) -> int:
        """Time at which it has left, ns: t4, or an upper limit if t4 is unknown."""
        if self.t4 is not None:
            return self.t4
        if self.t3 is None and self.given_up is not None:
            # It may have been on the belt until then.
            return self.given_up if self.t2 is None else max(self.given_up, self.t2)
        return (self.entered if self.t3 is None else self.t3) + 2 * self.length

    def fault(self, *reasons: Reason) -> None:
        """Add reasons why the item cannot be weighed."""
        self.faults.update(dict.fromkeys(reasons))

    def accounts_for(self, stamp: int, debounce: int) -> bool:
        """Return whether this item can have blocked the infeed eye at `stamp`, ns."""
        if self.t1 is None:
            return stamp < self.entered
        if self.t2 is None and Reason.CHATTERING_EYE in self.faults:
            return self.t1 <= stamp
        return self.t1 <= stamp <= (self.t1 if self.t2 is None else self.t2) + debounce

    def snapshot(self) -> 'TrackedItem':
        """Return a copy, which later edges do not change."""
        return replace(self, faults=dict(self.faults))
