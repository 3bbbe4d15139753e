# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stations that reject or sort items, in addition to the rejector of the line.

A station removes rejected items with one of its decisions or reasons, and accepted items in one of
its mass ranges in kg, such as ``0.150..0.155``. An item goes to the first station that removes it.
Rejected items that no station removes, such as items at an uncertain place, go to the rejector.
"""

from dataclasses import dataclass, replace
import math

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import NANOSECONDS, Decision, Verdict
from checkweigher_core.records.reasons import Reason

MAX_STATIONS = 16


@dataclass(frozen=True, slots=True)
class Station:
    """Place of a station, and the items that it removes."""

    distance: float  # distance from the outfeed eye in m
    delay: float  # time from the signal to the action of the station in s
    words: frozenset[str]  # decisions and reasons of the rejected items to remove
    ranges: tuple[tuple[float, float], ...]  # accepted masses to remove in kg, [lower, upper)

    def takes(self, verdict: Verdict) -> bool:
        """Return whether the station removes an item with this verdict."""
        if verdict.decision is Decision.ACCEPT:
            return any(low <= verdict.mass < high for low, high in self.ranges)
        return verdict.decision.name in self.words or not self.words.isdisjoint(verdict.reasons)

    def reject_time(self, t3: int, speed: float) -> int:
        """Return the time of the signal to the station in ns; `t3` is in ns and `speed` in m/s."""
        return t3 + round(NANOSECONDS * (self.distance / speed - self.delay))


def station_of(text: str, distance: float, delay: float, name: str) -> Station:
    """Return the station that a text describes.

    A word of the text is a decision that rejects, a reason, or a range of masses. Raises
    `ParameterError`, with the `name` of the parameter, if the text is empty or contains another
    word.
    """
    words, ranges = set[str](), list[tuple[float, float]]()
    for word in text.split():
        if '..' in word:
            ranges.append(_range(name, word))
        elif word in _WORDS:
            words.add(word)
        else:
            raise ParameterError(
                f'{name}: {word!r} is not a decision that rejects, a reason of a verdict, or a '
                'range of masses in kg such as 0.150..0.155'
            )
    if not words and not ranges:
        raise ParameterError(f'{name}: must state what the station removes')
    return Station(distance, delay, frozenset(words), tuple(ranges))


# Reasons of items whose identity or place is uncertain, which go to the rejector.
_NO_PLACE = {
    Reason.DISTANCE_FAULT,
    Reason.MISSING_EDGE,
    Reason.CHATTERING_EYE,
    Reason.LATE_EDGE,
    Reason.BELT_STOPPED,
    Reason.BELT_SPEED_CHANGED,
    Reason.CLOCK_JUMP,
    Reason.EDGE_MISMATCH,
    Reason.SOURCE_RESTARTED,
    Reason.STREAM_ENDED,
    Reason.FOREIGN_PUBLISHER,
}
_WORDS = {each.name for each in Decision if each is not Decision.ACCEPT} | set(Reason)


def _range(name: str, word: str) -> tuple[float, float]:
    try:
        low, high = (float(part) for part in word.split('..'))
    except ValueError:
        low = high = math.nan
    if not 0 <= low < high:
        raise ParameterError(f'{name}: {word!r} is not a mass range in kg such as 0.150..0.155')
    return low, high


def route(verdict: Verdict, stations: tuple[Station, ...], speed: float) -> Verdict:
    """Return a verdict with the station that removes the item; `speed` is in m/s or NaN.

    The verdict is returned without a station if no station removes the item, if the speed or t3 is
    unknown, or if the place of the item is uncertain.
    """
    if verdict.t3 is None or not speed > 0 or not _NO_PLACE.isdisjoint(verdict.reasons):
        return verdict
    for number, station in enumerate(stations, start=1):
        if station.takes(verdict):
            return replace(
                verdict, station=number, station_at=station.reject_time(verdict.t3, speed)
            )
    return verdict
