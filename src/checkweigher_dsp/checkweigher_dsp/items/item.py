# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""One item on the line: what the eyes have seen of it, and where it is by that."""

from dataclasses import dataclass, field, replace
from enum import Enum

from checkweigher_core.records.reasons import Reason


class State(Enum):
    """Where an item is, by the eyes."""

    ENTERING = 'it blocks the infeed eye'
    ON_BELT = 'it is between the eyes'
    LEAVING = 'it blocks the outfeed eye, or did so last'
    GONE = 'nothing more is to be seen of it'
    GIVEN_UP = 'it was reported without its t3; the outfeed eye may see it yet'
    ABANDONED = 'as GIVEN_UP, but its stream has ended: only what nothing else can be is this item'


YET_TO_LEAVE = (State.ENTERING, State.ON_BELT)


@dataclass(slots=True, eq=False)
class TrackedItem:
    """One item on the line: what the eyes have seen of it; all times in ns."""

    item_id: int  # in the order of entry
    t1: int | None = None  # begins to enter
    t2: int | None = None  # is fully on the belt
    t3: int | None = None  # begins to leave
    t4: int | None = None  # is gone
    # Why it cannot be weighed: a set in the order in which the reasons were found.
    faults: dict[Reason, None] = field(default_factory=dict)
    left_before: int | None = None  # the item before it; with `others_there` that is after t1
    others_there: bool = False  # at t1 the outfeed eye was blocked, or the t4 of an item lost
    usual_transit: int | None = None  # from eye to eye, of the last whole item before it
    given_up: int | None = None  # when it was given up
    outlier: bool = False  # far slower or faster than those before: its length may be wrong
    settled: bool = False  # its number stays: it is no flicker of the item before
    state: State = State.ON_BELT

    @property
    def entered(self) -> int:
        """Time at which it was seen first, ns."""
        if self.t1 is not None:
            return self.t1
        return next(stamp for stamp in (self.t2, self.t3) if stamp is not None)

    @property
    def length(self) -> int:
        """Time that it takes to pass an eye, ns; 0 if that is not known."""
        return self.t2 - self.t1 if self.t1 is not None and self.t2 is not None else 0

    @property
    def departure(self) -> int:
        """Time at which it is gone, ns: t4, or when its length must have passed the eye."""
        if self.t4 is not None:
            return self.t4
        if self.t3 is None and self.given_up is not None:
            # Until then it may have been there.
            return self.given_up if self.t2 is None else max(self.given_up, self.t2)
        last_seen = self.t3 if self.t3 is not None else self.entered
        return last_seen + 2 * self.length

    def fault(self, *reasons: Reason) -> None:
        """Note why the item cannot be weighed."""
        self.faults.update(dict.fromkeys(reasons))

    def accounts_for(self, stamp: int, debounce: int) -> bool:
        """Tell whether this item can have blocked the infeed eye at `stamp`, ns."""
        if self.t1 is None:
            later = [t for t in (self.t2, self.t3) if t is not None]
            return bool(later) and stamp < later[0]
        if self.t2 is None and Reason.CHATTERING_EYE in self.faults:
            return self.t1 <= stamp
        last = self.t2 if self.t2 is not None else self.t1
        return self.t1 <= stamp <= last + debounce

    def snapshot(self) -> 'TrackedItem':
        """Return the item as it is now: later edges do not change the copy."""
        return replace(self, faults=dict(self.faults))
