"""Which known mass belongs to which item."""

from bisect import bisect_left
from collections.abc import Iterable
import math

from checkweigher_dsp.records import NANOSECONDS, Reference

# A reference belongs to the item whose t1 it carries; half a block of slack for foreign bags.
_SAME_ITEM = NANOSECONDS // 100


class ReferenceMasses:
    """Known masses by the time of entry.

    Parameters
    ----------
    references : iterable of Reference
        In any order.
    """

    def __init__(self, references: Iterable[Reference]) -> None:
        self._references = sorted(references, key=lambda reference: reference.stamp)
        self._stamps = [reference.stamp for reference in self._references]

    def at(self, t1: int | None) -> float:
        """Return the mass in kg of the item that entered at `t1` in ns, NaN if it is not known."""
        if t1 is None:
            return math.nan
        position = bisect_left(self._stamps, t1 - _SAME_ITEM)
        near = self._references[position : position + 2]
        best = min(near, key=lambda reference: abs(reference.stamp - t1), default=None)
        return best.mass if best and abs(best.stamp - t1) <= _SAME_ITEM else math.nan
