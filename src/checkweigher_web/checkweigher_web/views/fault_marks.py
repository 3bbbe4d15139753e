# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Marks that explain a fault in the figure of its signal, each with a text and a time range."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, seconds
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.signal.rise_lag import RiseLag, rise_lag
from checkweigher_web.lane import ShownItem
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.raw_signal import Stretch

# Time between two edges of an eye below which the eye chatters, as a fraction of its longest
# blockage.
_FLICKER = 0.25
_BEFORE_RISE = 0.3  # duration in s of the signal before t1 that is used to find the lag of a rise
_GAP = 1.5  # time between two samples above which samples are lost, in sample periods
EYES = {Eye.INFEED: Text('infeed eye'), Eye.OUTFEED: Text('outfeed eye')}
# Edges of an item by name: the eye, and whether the item blocks the eye or clears it.
EDGES = {
    't1': (Eye.INFEED, True),
    't2': (Eye.INFEED, False),
    't3': (Eye.OUTFEED, True),
    't4': (Eye.OUTFEED, False),
}


@dataclass(frozen=True, slots=True)
class Mark:
    """Text on the signal from `begin` to `end` in ns, or on one moment if both are equal.

    `edge` is the key in `EDGES` of a missing edge that was expected at this moment, or ''.
    """

    text: str
    begin: int
    end: int
    edge: str = ''


class Scene:
    """Raw signal and photo-eye edges around an item.

    Attributes
    ----------
    times : dict of str to int
        Known times of the item in ns, by the names t1 to t4.
    force : array of shape (n,)
        Signal in kg, relative to the zero of calibration.
    usual_speed : float
        Belt speed of earlier items in m/s, or NaN if it is not known. If no earlier item had a
        speed, this is the `line_speed` of the estimate of this item.
    say : Language
        Language of the texts of the marks.
    """

    def __init__(
        self, item: ShownItem, stretch: Stretch, load_cell: LoadCell, say: Language = ENGLISH
    ) -> None:
        self.say = say
        self.reasons = item.verdict.reasons
        self.stretch = stretch
        self.load_cell = load_cell
        force = (stretch.counts - load_cell.zero_counts) / load_cell.counts_per_kg
        self.force = np.asarray(force, np.float64)
        self.times = item.times
        self.usual_speed = item.usual_speed
        if math.isnan(self.usual_speed) and item.estimate is not None:
            self.usual_speed = item.estimate.line_speed

    def between(self, begin: int, end: int) -> NDArray[np.float64]:
        """Return the signal from `begin` to `end` in ns, shape (m,), in kg."""
        time = self.stretch.time
        return self.force[(begin <= time) & (time <= end)]

    def mean(self, begin: int, end: int) -> float:
        """Return the mean of the signal in kg from `begin` to `end` in ns, NaN without samples."""
        force = self.between(begin, end)
        return float(np.mean(force)) if len(force) else math.nan

    def span(self, first: str, last: str) -> tuple[int, int] | None:
        """Return the times in ns of two edges of the item, or None if one of them is missing."""
        if first not in self.times or last not in self.times:
            return None
        return self.times[first], self.times[last]

    def edges_of(self, eye: Eye) -> list[EyeEdge]:
        """Return the edges of an eye in order of time."""
        edges = (edge for edge in self.stretch.edges if edge.eye == eye)
        return sorted(edges, key=lambda edge: edge.stamp)


def fault_marks(scene: Scene) -> list[Mark]:
    """Return the marks that explain a fault, in the order of its reasons.

    A reason that the signal cannot show has no mark.
    """
    finders = (_FINDERS[Reason(each)] for each in scene.reasons if each in _FINDERS)
    return [mark for find in finders for mark in find(scene)]


def empty_belt(scene: Scene) -> tuple[int, int, float] | None:
    """Return the start and end in ns of the empty belt before an item, and the mean load in kg.

    The mean is relative to the zero of calibration. Returns None if t1 of the item is unknown, or
    if there are no samples of the empty belt.
    """
    end = scene.times.get('t1')
    if end is None:
        return None
    left = [edge.stamp for edge in scene.edges_of(Eye.OUTFEED) if edge.stamp < end]
    begin = max([int(scene.stretch.time[0]), *left])
    reading = scene.mean(begin, end)
    return None if math.isnan(reading) else (begin, end, reading)


def expected_rise(scene: Scene) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Return the rise of the load that the edges predict, as time (n,) in ns and force (n,) in kg.

    Returns None if the item does not have the reason EDGE_MISMATCH, or if edges or samples are
    missing.
    """
    rise, rest = scene.span('t1', 't2'), scene.span('t2', 't3')
    if Reason.EDGE_MISMATCH not in scene.reasons or rise is None or rest is None:
        return None
    empty, level = scene.mean(int(scene.stretch.time[0]), rise[0]), scene.mean(*rest)
    if math.isnan(empty + level):
        return None
    time = scene.stretch.time[scene.stretch.time <= rest[1]]
    share = np.clip((time - rise[0]) / max(rise[1] - rise[0], 1), 0.0, 1.0)
    return time, empty + (level - empty) * share


Finder = Callable[[Scene], Iterable[Mark]]


def _over(
    first: str, last: str, describe: Callable[[Scene, int, int], str], scene: Scene
) -> Iterator[Mark]:
    """Mark the time from the edge `first` to the edge `last` with the text from `describe`.

    There is no mark if an edge is missing or the text is empty.
    """
    span = scene.span(first, last)
    text = '' if span is None else describe(scene, *span)
    if span is not None and text:
        yield Mark(text, *span)


def _missing_edges(scene: Scene) -> Iterator[Mark]:
    expected, say = _expected_times(scene), scene.say
    missing = [name for name in ('t1', 't2', 't3') if name not in scene.times]
    if not missing:
        yield from _equal_edges(scene)
    for name in missing:
        eye, blocked = EDGES[name]
        text = (
            Text('{eye}: {edge} is missing, it did not block', eye=EYES[eye], edge=name)
            if blocked
            else Text('{eye}: {edge} is missing, it did not clear', eye=EYES[eye], edge=name)
        )
        if name in expected:
            at = expected[name]
            yield Mark(say('{missing}; expected here', missing=text), at, at, name)
        elif scene.times:
            last = max(scene.times.values())
            yield Mark(say('{missing} after this', missing=text), last, last)


def _equal_edges(scene: Scene) -> Iterator[Mark]:
    """Mark each pair of successive edges of an eye between which an edge must be missing.

    An edge is missing if the eye becomes blocked at both edges, or clear at both edges.
    """
    for eye in Eye:
        for one, other in pairwise(scene.edges_of(eye)):
            if one.blocked == other.blocked:
                text = (
                    Text('{eye}: blocked twice; the edge between is missing', eye=EYES[eye])
                    if one.blocked
                    else Text('{eye}: cleared twice; the edge between is missing', eye=EYES[eye])
                )
                yield Mark(scene.say(text), one.stamp, other.stamp)


def _expected_times(scene: Scene) -> dict[str, int]:
    """Return the times in ns at which the edges t1, t2 and t3 of an item are expected, by name.

    The difference between t1 and t3 follows from the usual belt speed. The difference between t1
    and t2 is the time for which the item blocks an eye. Edges whose time cannot be computed are
    left out.
    """
    times, found, speed = scene.times, dict[str, int](), scene.usual_speed
    if speed > 0:
        transit = round(NANOSECONDS * scene.load_cell.weigh_length / speed)
        if 't1' in times:
            found['t3'] = times['t1'] + transit
        if 't3' in times:
            found['t1'] = times['t3'] - transit
    ends = scene.span('t1', 't2') or scene.span('t3', 't4')
    entered = times.get('t1', found.get('t1'))
    if ends is not None and entered is not None:
        found['t2'] = entered + ends[1] - ends[0]
    return found


def _two_products(scene: Scene) -> list[Mark]:
    return [*_neighbours(scene)] or [*_over('t2', 't3', _change, scene)]


def _neighbours(scene: Scene) -> Iterator[Mark]:
    """Mark the time in which another product was also on the belt."""
    span = scene.span('t1', 't3')
    if span is None:
        return
    begin, end = span
    for edge in scene.edges_of(Eye.INFEED):
        if edge.blocked and begin < edge.stamp < end:
            text = scene.say('the next product is on the belt as well')
            yield Mark(text, edge.stamp, end)
    left = [edge.stamp for edge in scene.edges_of(Eye.OUTFEED) if begin < edge.stamp < end]
    if left:
        yield Mark(scene.say('the product before is still on the belt'), begin, left[-1])


def _change(scene: Scene, begin: int, end: int) -> str:
    load = scene.between(begin, end)
    if len(load) < 4:
        return ''
    change = float(np.mean(load[-(len(load) // 4) :]) - np.mean(load[: len(load) // 2]))
    return scene.say(
        'the load changes by {change}: something came onto the belt or left it that the eyes did '
        'not show',
        change=scene.say.mass(change, 1, '+'),
    )


def _chatter(scene: Scene) -> Iterator[Mark]:
    for eye in Eye:
        edges = scene.edges_of(eye)
        stamps = np.array([edge.stamp for edge in edges], np.int64)
        if len(stamps) < 3:
            continue
        lengths = np.diff(stamps)
        blocked = lengths[[edge.blocked for edge in edges[:-1]]]
        longest = blocked.max() if len(blocked) else lengths.max()
        for begin, end in runs(lengths < _FLICKER * longest):
            text = scene.say(
                '{eye}: switches {count} times in {time}',
                eye=EYES[eye],
                count=end - begin + 1,
                time=scene.say.number(1e-6 * (stamps[end] - stamps[begin]), 1, ' ms'),
            )
            yield Mark(text, int(stamps[begin]), int(stamps[end]))


def _speed(scene: Scene, begin: int, end: int) -> str:
    if end <= begin:
        return ''
    speed, say = scene.load_cell.weigh_length / seconds(end - begin), scene.say
    text = say(
        'from eye to eye in {time}: {speed}',
        time=say.number(1e-6 * (end - begin), 0, ' ms'),
        speed=say.number(60 * speed, 1, ' m/min'),
    )
    if math.isfinite(scene.usual_speed) and scene.usual_speed != speed:
        before = say.number(60 * scene.usual_speed, 1, ' m/min')
        text = say('{speed}; the item before: {before}', speed=text, before=before)
    return text


def _length(scene: Scene, begin: int, end: int) -> str:
    time, say = scene.say.number(1e-6 * (end - begin), 0, ' ms'), scene.say
    belt, out = scene.load_cell.weigh_length, scene.times.get('t3', begin)
    if out > begin:
        length = belt * (end - begin) / (out - begin)
        return say(
            'the infeed eye is blocked for {time}: {length} on a belt of {belt}',
            time=time,
            length=say.number(1e3 * length, 0, ' mm'),
            belt=say.number(1e3 * belt, 0, ' mm'),
        )
    return say('the infeed eye is blocked for {time}', time=time)


def _short_window(scene: Scene, begin: int, end: int) -> str:
    return scene.say.plural(
        'fully on the belt for {count} sample',
        'fully on the belt for {count} samples',
        len(scene.between(begin, end)),
    )


def _lost_samples(scene: Scene) -> Iterator[Mark]:
    time, period = scene.stretch.time, NANOSECONDS / scene.load_cell.sample_rate
    for place in np.flatnonzero(np.diff(time) > _GAP * period):
        begin, end = int(time[place]), int(time[place + 1])
        count = round((end - begin) / period) - 1
        text = scene.say.plural(
            '{count} sample lost in {time}',
            '{count} samples lost in {time}',
            count,
            time=scene.say.number(1e-6 * (end - begin), 1, ' ms'),
        )
        yield Mark(text, begin, end)


def _saturation(scene: Scene) -> Iterator[Mark]:
    time, counts, cell = scene.stretch.time, scene.stretch.counts, scene.load_cell
    for is_low, outside in ((True, counts <= cell.min_counts), (False, counts >= cell.max_counts)):
        for begin, end in runs(outside):
            text = (
                scene.say.plural(
                    '{count} sample at the lowest value of the converter',
                    '{count} samples at the lowest value of the converter',
                    end - begin,
                )
                if is_low
                else scene.say.plural(
                    '{count} sample at the highest value of the converter',
                    '{count} samples at the highest value of the converter',
                    end - begin,
                )
            )
            yield Mark(text, int(time[begin]), int(time[end - 1]))


def _sample(place: int, text: str, scene: Scene) -> list[Mark]:
    stamp = int(scene.stretch.time[place])
    return [Mark(scene.say(text), stamp, stamp)]


def _load(text: str, scene: Scene) -> Iterator[Mark]:
    """Mark the time from t2 to t3. `text` may contain the placeholders `load` and `capacity`."""

    def describe(scene: Scene, begin: int, end: int) -> str:
        load, say = scene.mean(begin, end), scene.say
        masses = {'load': say.mass(load, 1), 'capacity': say.mass(scene.load_cell.capacity, 0)}
        return '' if math.isnan(load) else say(text, **masses)

    return _over('t2', 't3', describe, scene)


def _zero(scene: Scene) -> Iterator[Mark]:
    found = empty_belt(scene)
    if found is not None:
        begin, end, reading = found
        text = scene.say(
            'the empty belt reads {mass} from the zero of calibration',
            mass=scene.say.mass(reading, 1, '+'),
        )
        yield Mark(text, begin, end)


def _late_edges(scene: Scene) -> Iterator[Mark]:
    latest = 0
    for edge in scene.stretch.edges:  # in order of arrival
        if edge.stamp < latest:
            text = scene.say(
                '{eye}: this edge came after one that is {time} younger',
                eye=EYES[edge.eye],
                time=scene.say.number(1e-6 * (latest - edge.stamp), 1, ' ms'),
            )
            yield Mark(text, edge.stamp, edge.stamp)
        latest = max(latest, edge.stamp)


def _mismatch(scene: Scene) -> Iterator[Mark]:
    rise, out = scene.span('t1', 't2'), scene.times.get('t3')
    if rise is None:
        return
    seen = RiseLag() if out is None else _rise(scene, *rise, out)
    if not seen.is_known:
        yield Mark(scene.say('the rise does not follow the eyes'), *rise)
        return
    shift, time = round(NANOSECONDS * seen.lag), scene.say.number(1e3 * abs(seen.lag), 1, ' ms')
    text = (
        scene.say('the load rises {time} later than the eyes say', time=time)
        if seen.lag > 0
        else scene.say('the load rises {time} earlier than the eyes say', time=time)
    )
    yield Mark(text, min(rise[0], rise[0] + shift), max(rise[0], rise[0] + shift))


def _rise(scene: Scene, t1: int, t2: int, t3: int) -> RiseLag:
    time = scene.stretch.time
    used = (time >= t1 - round(NANOSECONDS * _BEFORE_RISE)) & (time <= t3)
    since = (time[used] - t1) / NANOSECONDS
    if len(since) < 2 or since[0] >= 0:
        return RiseLag()
    return rise_lag(scene.force[used], since, seconds(t2 - t1), seconds(t3 - t1))


def runs(inside: Sequence[bool] | NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the indices of the start and the end of each run of true values.

    The end is the index after the last true value of the run.
    """
    ends = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return [(int(b), int(e)) for b, e in zip(ends[::2], ends[1::2], strict=True)]


_LENGTH = partial(_over, 't1', 't2', _length)
_SPEED = partial(_over, 't1', 't3', _speed)
# Functions that find the marks of a reason, for each reason that the signal can show.
_FINDERS: dict[Reason, Finder] = {
    Reason.DISTANCE_FAULT: _two_products,
    Reason.MISSING_EDGE: _missing_edges,
    Reason.CHATTERING_EYE: _chatter,
    Reason.PRODUCT_TOO_LONG: _LENGTH,
    Reason.PRODUCT_TOO_SHORT: _LENGTH,
    Reason.PRODUCT_ASKEW: _LENGTH,
    Reason.BELT_SPEED: _SPEED,
    Reason.BELT_SPEED_CHANGED: _SPEED,
    Reason.BELT_STOPPED: _SPEED,
    Reason.SPEED_NOT_TRAINED: _SPEED,
    Reason.WINDOW_TOO_SHORT: partial(_over, 't2', 't3', _short_window),
    Reason.SAMPLES_LOST: _lost_samples,
    Reason.CLOCK_JUMP: _lost_samples,
    Reason.SATURATION: _saturation,
    Reason.STREAM_ENDED: partial(_sample, -1, Text('the samples end here')),
    Reason.SOURCE_RESTARTED: partial(_sample, -1, Text('the source began again after this')),
    Reason.START_UP: partial(_sample, 0, Text('the samples begin here')),
    Reason.NO_LOAD: partial(_load, Text('the load is {load}: nothing rests on the belt')),
    Reason.OVERLOAD: partial(
        _load, Text('the load is {load}, the capacity of the cell {capacity}')
    ),
    Reason.NO_CONVERGENCE: partial(_load, Text('no level was found here; the mean is {load}')),
    Reason.ZERO_OUT_OF_RANGE: _zero,
    Reason.LATE_EDGE: _late_edges,
    Reason.EDGE_MISMATCH: _mismatch,
}
