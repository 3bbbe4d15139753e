"""What the eyes have seen of one item."""

from dataclasses import dataclass, field, fields
from operator import attrgetter

from checkweigher_dsp.reasons import Reason


@dataclass(slots=True, eq=False)
class Item:
    """One item on the line, as far as the eyes have seen it; stamps in ns."""

    item_id: int
    t1: int | None = None
    t2: int | None = None
    t3: int | None = None
    t4: int | None = None
    faults: dict[Reason, None] = field(default_factory=dict)  # an ordered set
    left_before: int | None = None  # when the item before it was gone, after t1 with `others_there`
    others_there: bool = False  # at t1 the outfeed eye was covered, or its t4 was lost
    usual_transit: int | None = None  # from eye to eye, of the last whole item before it
    given_up: int | None = None  # when it was given up
    odd: bool = False  # took far longer or shorter than those before: its length may be wrong

    @property
    def entered(self) -> int:
        """When it was seen first, ns."""
        known = [stamp for stamp in (self.t1, self.t2, self.t3) if stamp is not None]
        return known[0]

    def fault(self, reason: Reason) -> None:
        """Note why the item cannot be weighed."""
        self.faults.setdefault(reason)


_state = attrgetter(*(entry.name for entry in fields(Item)))


def snapshot(item: Item) -> Item:
    """Return an item as it is now: what comes later of it does not change that."""
    taken = Item(*_state(item))
    taken.faults = dict(item.faults)
    return taken


def departure(item: Item) -> int:
    """Return t4, or where the eye missed it the time by which the item's length had passed."""
    if item.t4 is not None:
        return item.t4
    if item.t3 is None and item.given_up is not None:
        # Until then it may have been there.
        return item.given_up if item.t2 is None else max(item.given_up, item.t2)
    last_seen = item.t3 if item.t3 is not None else item.entered
    return last_seen + 2 * length(item)


def accounts_for(item: Item, stamp: int, debounce: int) -> bool:
    """Tell whether the infeed eye was blocked at `stamp` by this item, and note its t1."""
    if item.t1 is not None:
        if item.t2 is None and Reason.CHATTERING_EYE in item.faults:
            return item.t1 <= stamp
        last = item.t2 if item.t2 is not None else item.t1
        return item.t1 <= stamp <= last + debounce
    later = [t for t in (item.t2, item.t3) if t is not None]
    if later and stamp < later[0]:
        item.t1 = stamp
        return True
    return False


def length(item: Item) -> int:
    """Return how long an item takes to pass an eye, ns; 0 if that is not known."""
    return item.t2 - item.t1 if item.t1 is not None and item.t2 is not None else 0
