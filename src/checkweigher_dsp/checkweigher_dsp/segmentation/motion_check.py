# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Measurement of belt speed and product length by the photo-eyes, with plausibility checks."""

import math

from checkweigher_core.records import seconds
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.item import TrackedItem
from checkweigher_dsp.segmentation.parameters import SegmenterParameters

_STOPPED = 0.5  # fraction of the usual speed below which a stop of the belt is assumed


class MotionCheck:
    """Check of the speed and length of items.

    The belt speed is compared with the speed of earlier items, because two items with lost edges
    look like one slow and long item. The first item after a change of the belt speed is a fault.
    The next item is weighed if its speed confirms the new belt speed. `weigh_length` is the
    distance between the eyes in m.
    """

    def __init__(self, weigh_length: float, parameters: SegmenterParameters) -> None:
        self._weigh_length = weigh_length
        self._limits = parameters
        self._usual: float | None = None  # last accepted belt speed in m/s
        self._last: float | None = None  # belt speed of the last checked item in m/s

    def forget(self) -> None:
        """Discard the belt speed, because the source of the samples has started again."""
        self._usual = self._last = None

    def measure(self, item: TrackedItem) -> tuple[float, float]:
        """Return the belt speed in m/s and the product length in m.

        The speed and the length are NaN if t1 or t3 is missing, or if t3 is not after t1. Only the
        length is NaN if t2 is missing.
        """
        if item.t1 is None or item.t3 is None or item.t3 <= item.t1:
            return math.nan, math.nan
        speed = self._weigh_length / seconds(item.t3 - item.t1)
        length = math.nan if item.t2 is None else speed * seconds(item.t2 - item.t1)
        return speed, length

    def check(self, item: TrackedItem) -> None:
        """Add faults to an item whose speed or length is not plausible.

        The caller must check each item once, in the order of departure.
        """
        limits = self._limits
        speed, length = self.measure(item)
        known = None not in (item.t1, item.t3)
        if known and not limits.min_belt_speed <= speed <= limits.max_belt_speed:
            item.fault(Reason.BELT_SPEED)
        if length < limits.min_product_length:
            item.fault(Reason.PRODUCT_TOO_SHORT)
        if length >= self._weigh_length:
            item.fault(Reason.PRODUCT_TOO_LONG)
        if item.faults or math.isnan(length):
            return
        if limits.speed_tolerance:
            self._check_speed(item, speed)
        if limits.product_length and not item.faults:
            self._check_length(item, length)

    def _check_speed(self, item: TrackedItem, speed: float) -> None:
        usual, last, tolerance = self._usual, self._last, self._limits.speed_tolerance
        self._last = speed
        known = [before for before in (usual, last) if before is not None]
        if usual is None or any(abs(speed - before) <= tolerance * before for before in known):
            self._usual = speed
        else:
            stopped = speed < _STOPPED * usual
            item.fault(Reason.BELT_STOPPED if stopped else Reason.BELT_SPEED_CHANGED)

    def _check_length(self, item: TrackedItem, length: float) -> None:
        """Add a fault to an item whose length differs too much from ``product_length``.

        The eyes measure the extent of an item along the belt. For a rectangle at an angle, this
        extent is between the shorter side and the diagonal.
        """
        expected, tolerance = self._limits.product_length, self._limits.length_tolerance
        width = self._limits.product_width or expected
        if abs(length - expected) <= tolerance:
            return
        shortest = min(expected, width)
        longest = math.hypot(expected, width) if self._limits.product_width else expected
        if shortest - tolerance <= length <= longest + tolerance:
            item.fault(Reason.PRODUCT_ASKEW)
        else:
            short = length < expected
            item.fault(Reason.PRODUCT_TOO_SHORT if short else Reason.PRODUCT_TOO_LONG)
