# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What broke in the signal of a fault: for each reason the places where that shows, in words."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.printable import counted
from checkweigher_core.records import GRAMS, NANOSECONDS, Eye, EyeEdge, LoadCell, seconds
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.signal.rise_lag import RiseLag, rise_lag
from checkweigher_web.lane import Item, Stretch

_BEFORE_RISE = 0.3  # s of empty belt that a rise is compared with
_GAP = 1.5  # sample periods without a sample: some are lost
# Of the longest time that an eye was blocked; what is shorter is no product.
_FLICKER = 0.25
_EYES = {Eye.INFEED: 'infeed eye', Eye.OUTFEED: 'outfeed eye'}
# The edges of an item: which eye, and whether the item blocks it.
EDGES = {
    't1': (Eye.INFEED, True), 't2': (Eye.INFEED, False),
    't3': (Eye.OUTFEED, True), 't4': (Eye.OUTFEED, False),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Mark:
    """A place in the signal, `begin` to `end` in ns, and what is wrong there.

    A moment has equal ends. `edge` is the one of `EDGES` that was expected there and did not come.
    """

    text: str
    begin: int
    end: int
    edge: str = ''


@dataclass(frozen=True, slots=True)
class Expected:
    """A signal that should have been there: `time` (n,) in ns, `force` (n,) in kg."""

    time: NDArray[np.int64]
    force: NDArray[np.float64]


class Scene:
    """The stretch of an item and what the eyes saw of it.

    `times` has t1 to t4 in ns as far as they are known, `usual_speed` is that of the items before,
    m/s or NaN.
    """

    def __init__(self, item: Item, stretch: Stretch, load_cell: LoadCell) -> None:
        self.stretch = stretch
        self.load_cell = load_cell
        known = item.estimate
        times = {
            't1': item.verdict.t1, 't2': known.t2 if known is not None else None,
            't3': item.verdict.t3, 't4': item.t4,
        }  # fmt: skip
        self.times = {name: stamp for name, stamp in times.items() if stamp is not None}
        self.usual_speed = item.usual_speed
        if math.isnan(self.usual_speed) and known is not None:
            self.usual_speed = known.line_speed

    @property
    def force(self) -> NDArray[np.float64]:
        """The signal from the zero of calibration, (n,) kg."""
        cell = self.load_cell
        return np.asarray((self.stretch.counts - cell.zero_counts) / cell.counts_per_kg)

    def between(self, begin: int, end: int) -> NDArray[np.float64]:
        """Return the signal from `begin` to `end`, ns: (m,) kg."""
        time = self.stretch.time
        return self.force[(begin <= time) & (time <= end)]

    def span(self, first: str, last: str) -> tuple[int, int] | None:
        """Return the times of two edges of the item, None without both."""
        if first not in self.times or last not in self.times:
            return None
        return self.times[first], self.times[last]

    def edges_of(self, eye: Eye) -> list[EyeEdge]:
        """Return the edges of an eye by their stamps."""
        return sorted(
            (edge for edge in self.stretch.edges if edge.eye == eye), key=lambda edge: edge.stamp
        )


def fault_marks(item: Item, stretch: Stretch, load_cell: LoadCell) -> list[Mark]:
    """Return what is wrong in the signal of an item, in the order of its reasons."""
    scene = Scene(item, stretch, load_cell)
    marks: list[Mark] = []
    for reason in item.verdict.reasons:
        if reason in _FINDERS:
            marks += _FINDERS[Reason(reason)](scene)
    return marks


def empty_reading(item: Item, stretch: Stretch, load_cell: LoadCell) -> float:
    """Return what the empty belt read before an item, kg from the zero of calibration, or NaN."""
    found = _empty_belt(Scene(item, stretch, load_cell))
    return math.nan if found is None else found[2]


def expected_rise(item: Item, stretch: Stretch, load_cell: LoadCell) -> Expected | None:
    """Return the load as it should rise by the eyes; None unless the rise contradicts them."""
    scene = Scene(item, stretch, load_cell)
    rise, rest = scene.span('t1', 't2'), scene.span('t2', 't3')
    if Reason.EDGE_MISMATCH not in item.verdict.reasons or rise is None or rest is None:
        return None
    time = stretch.time[stretch.time <= rest[1]]
    before, level = scene.between(int(stretch.time[0]), rise[0]), scene.between(*rest)
    if not len(before) or not len(level):
        return None
    share = np.clip((time - rise[0]) / max(rise[1] - rise[0], 1), 0.0, 1.0)
    empty = float(np.mean(before))
    return Expected(time, empty + (float(np.mean(level)) - empty) * share)


def _missing_edges(scene: Scene) -> Iterator[Mark]:
    expected = _expected_times(scene)
    missing = [name for name in ('t1', 't2', 't3') if name not in scene.times]
    for name in missing:
        eye, blocked = EDGES[name]
        text = f'{_EYES[eye]}: {name} is missing, it did not {"block" if blocked else "clear"}'
        if name in expected:
            yield Mark(f'{text}; expected here', expected[name], expected[name], name)
        elif scene.times:
            last = max(scene.times.values())
            yield Mark(f'{text} after this', last, last)
    for eye in Eye if not missing else ():
        edges = scene.edges_of(eye)
        for one, other in pairwise(edges):
            if one.blocked == other.blocked:
                what = 'blocked' if one.blocked else 'cleared'
                text = f'{_EYES[eye]}: {what} twice; the edge between is missing'
                yield Mark(text, one.stamp, other.stamp)


def _expected_times(scene: Scene) -> dict[str, int]:
    """Return when the edges of the item should have come, by the speed of the items before."""
    times, found = scene.times, {}
    speed = scene.usual_speed
    transit = round(NANOSECONDS * scene.load_cell.weigh_length / speed) if speed > 0 else None
    length = next(
        (ends[1] - ends[0] for ends in (scene.span('t1', 't2'), scene.span('t3', 't4')) if ends),
        None,
    )
    if transit is not None:
        if 't1' in times:
            found['t3'] = times['t1'] + transit
        if 't3' in times:
            found['t1'] = times['t3'] - transit
    entered = times.get('t1', found.get('t1'))
    if length is not None and entered is not None:
        found['t2'] = entered + length
    return found


def _two_products(scene: Scene) -> Iterator[Mark]:
    ends = scene.span('t1', 't3')
    seen = False
    if ends is not None:
        for edge in scene.edges_of(Eye.INFEED):
            if edge.blocked and ends[0] < edge.stamp < ends[1]:
                seen = True
                yield Mark('the next product is on the belt as well', edge.stamp, ends[1])
        left = [edge.stamp for edge in scene.edges_of(Eye.OUTFEED) if edge.stamp < ends[1]]
        if left and left[-1] > ends[0]:
            seen = True
            yield Mark('the product before is still on the belt', ends[0], left[-1])
    rest = scene.span('t2', 't3')
    load = scene.between(*rest) if rest else np.zeros(0)
    if rest and not seen and len(load) >= 4:
        size = len(load)
        change = float(np.mean(load[size - size // 4 :]) - np.mean(load[: size // 2]))
        yield Mark(
            f'the load changes by {GRAMS * change:+.1f} g: something came onto the belt or left '
            'it that the eyes did not show', *rest,
        )  # fmt: skip


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
            span = 1e-6 * (stamps[end] - stamps[begin])
            text = f'{_EYES[eye]}: switches {end - begin + 1} times in {span:.1f} ms'
            yield Mark(text, int(stamps[begin]), int(stamps[end]))


def _speed(scene: Scene) -> Iterator[Mark]:
    ends = scene.span('t1', 't3')
    if ends is None or ends[1] <= ends[0]:
        return
    speed = scene.load_cell.weigh_length / seconds(ends[1] - ends[0])
    text = f'from eye to eye in {1e-6 * (ends[1] - ends[0]):.0f} ms: {60 * speed:.1f} m/min'
    if math.isfinite(scene.usual_speed) and scene.usual_speed != speed:
        text += f'; the item before: {60 * scene.usual_speed:.1f} m/min'
    yield Mark(text, *ends)


def _length(scene: Scene) -> Iterator[Mark]:
    ends, transit = scene.span('t1', 't2'), scene.span('t1', 't3')
    if ends is None:
        return
    text = f'the infeed eye is blocked for {1e-6 * (ends[1] - ends[0]):.0f} ms'
    if transit is not None and transit[1] > transit[0]:
        length = scene.load_cell.weigh_length * (ends[1] - ends[0]) / (transit[1] - transit[0])
        text += f': {1e3 * length:.0f} mm on a belt of {1e3 * scene.load_cell.weigh_length:.0f} mm'
    yield Mark(text, *ends)


def _short_window(scene: Scene) -> Iterator[Mark]:
    rest = scene.span('t2', 't3')
    if rest is not None:
        yield Mark(f'fully on the belt for {counted(len(scene.between(*rest)), "sample")}', *rest)


def _lost_samples(scene: Scene) -> Iterator[Mark]:
    time, period = scene.stretch.time, NANOSECONDS / scene.load_cell.sample_rate
    for place in np.flatnonzero(np.diff(time) > _GAP * period):
        begin, end = int(time[place]), int(time[place + 1])
        count = round((end - begin) / period) - 1
        yield Mark(f'{counted(count, "sample")} lost in {1e-6 * (end - begin):.1f} ms', begin, end)


def _saturation(scene: Scene) -> Iterator[Mark]:
    time, counts, cell = scene.stretch.time, scene.stretch.counts, scene.load_cell
    for name, outside in (
        ('lowest', counts <= cell.min_counts), ('highest', counts >= cell.max_counts)
    ):  # fmt: skip
        for begin, end in runs(outside):
            text = f'{counted(end - begin, "sample")} at the {name} value of the converter'
            yield Mark(text, int(time[begin]), int(time[end - 1]))


def _moment(scene: Scene, place: int, text: str) -> Iterator[Mark]:
    stamp = int(scene.stretch.time[place])
    yield Mark(text, stamp, stamp)


def _load(scene: Scene, text: str) -> Iterator[Mark]:
    rest = scene.span('t2', 't3')
    load = scene.between(*rest) if rest else np.zeros(0)
    if rest and len(load):
        capacity = GRAMS * scene.load_cell.capacity
        yield Mark(text.format(load=GRAMS * float(np.mean(load)), capacity=capacity), *rest)


def _empty_belt(scene: Scene) -> tuple[int, int, float] | None:
    """Return the time before an item in which the belt was empty, ns, and its reading, kg."""
    begin, end = int(scene.stretch.time[0]), scene.times.get('t1')
    if end is None:
        return None
    # Of the belt since the item before has left.
    left = [edge.stamp for edge in scene.edges_of(Eye.OUTFEED) if edge.stamp < end]
    begin = max([begin, *left])
    empty = scene.between(begin, end)
    return (begin, end, float(np.mean(empty))) if len(empty) else None


def _zero(scene: Scene) -> Iterator[Mark]:
    found = _empty_belt(scene)
    if found is not None:
        begin, end, reading = found
        text = f'the empty belt reads {GRAMS * reading:+.1f} g from the zero of calibration'
        yield Mark(text, begin, end)


def _late_edges(scene: Scene) -> Iterator[Mark]:
    latest: EyeEdge | None = None
    for edge in scene.stretch.edges:  # in the order in which they came
        if latest is not None and edge.stamp < latest.stamp:
            behind = 1e-6 * (latest.stamp - edge.stamp)
            text = f'{_EYES[edge.eye]}: this edge came after one that is {behind:.1f} ms younger'
            yield Mark(text, edge.stamp, edge.stamp)
        else:
            latest = edge


def _mismatch(scene: Scene) -> Iterator[Mark]:
    seen = _rise(scene)
    rise = scene.span('t1', 't2')
    if rise is None:
        return
    if not seen.is_known:
        yield Mark('the rise does not follow the eyes', *rise)
        return
    way = 'later' if seen.lag > 0 else 'earlier'
    shift = round(NANOSECONDS * seen.lag)
    text = f'the load rises {1e3 * abs(seen.lag):.1f} ms {way} than the eyes say'
    yield Mark(text, min(rise[0], rise[0] + shift), max(rise[0], rise[0] + shift))


def _rise(scene: Scene) -> RiseLag:
    rise, transit = scene.span('t1', 't2'), scene.span('t1', 't3')
    if rise is None or transit is None:
        return RiseLag()
    t1, time = rise[0], scene.stretch.time
    used = (time >= t1 - round(NANOSECONDS * _BEFORE_RISE)) & (time <= transit[1])
    since = (time[used] - t1) / NANOSECONDS
    if len(since) < 2 or since[0] >= 0:
        return RiseLag()
    return rise_lag(
        scene.force[used], since, seconds(rise[1] - t1), seconds(transit[1] - t1)
    )  # fmt: skip


def runs(inside: Sequence[bool] | NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of each run of true values."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return [(int(b), int(e)) for b, e in zip(ends[::2], ends[1::2], strict=True)]


# What is not here shows in no place of the signal: its hint says what to check.
_FINDERS: dict[Reason, Callable[[Scene], Iterator[Mark]]] = {
    Reason.DISTANCE_FAULT: _two_products,
    Reason.MISSING_EDGE: _missing_edges,
    Reason.CHATTERING_EYE: _chatter,
    Reason.PRODUCT_TOO_LONG: _length,
    Reason.PRODUCT_TOO_SHORT: _length,
    Reason.PRODUCT_ASKEW: _length,
    Reason.BELT_SPEED: _speed,
    Reason.BELT_SPEED_CHANGED: _speed,
    Reason.BELT_STOPPED: _speed,
    Reason.SPEED_NOT_TRAINED: _speed,
    Reason.WINDOW_TOO_SHORT: _short_window,
    Reason.SAMPLES_LOST: _lost_samples,
    Reason.CLOCK_JUMP: _lost_samples,
    Reason.SATURATION: _saturation,
    Reason.STREAM_ENDED: partial(_moment, place=-1, text='the samples end here'),
    Reason.SOURCE_RESTARTED: partial(_moment, place=-1, text='the source began again after this'),
    Reason.START_UP: partial(_moment, place=0, text='the samples begin here'),
    Reason.NO_LOAD: partial(_load, text='the load is {load:.1f} g: nothing rests on the belt'),
    Reason.OVERLOAD: partial(
        _load, text='the load is {load:.1f} g, the capacity of the cell {capacity:.0f} g'
    ),
    Reason.NO_CONVERGENCE: partial(_load, text='no level was found here; the mean is {load:.1f} g'),
    Reason.ZERO_OUT_OF_RANGE: _zero,
    Reason.LATE_EDGE: _late_edges,
    Reason.EDGE_MISMATCH: _mismatch,
}
