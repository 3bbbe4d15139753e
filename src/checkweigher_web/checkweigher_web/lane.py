# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Latest records of a lane: items with their signals, and messages of the nodes."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice, pairwise
import math
from statistics import median
import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import Event, Recording
from checkweigher_core.records import (
    NANOSECONDS,
    Alarm,
    Alarms,
    Decision,
    EyeEdge,
    FillerFeedback,
    LoadCell,
    MassEstimate,
    NanEqual,
    Reference,
    SampleBlock,
    Statistics,
    StopRequest,
    Verdict,
    WeighWindow,
    ZeroChange,
)
from checkweigher_dsp.pipeline.line import Weighing
from checkweigher_validation.accuracy.results import ResultJoiner
from checkweigher_web.history import History, history_of
from checkweigher_web.languages.language import Mass, Text
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.raw_signal import RawSignal, Stretch

# Key of an item: t1 and t3 in ns. The number of an item is not unique, because a lane may count
# from 1 again after a restart.
Key = tuple[int | None, int | None]
# Maximum number of listed items.
MAX_ITEMS = 500
# Maximum number of verdicts, of estimates and of noise values, which should suffice for an hour.
_MAX_HOUR = 7200
_MAX_WINDOWS = 50
_MAX_OVER = 20  # maximum number of ended alarms
_MAX_EDGES = 400
SHOWN = 20.0  # duration in s of the samples that a lane holds for the views
_MINUTE = 60 * NANOSECONDS
# Number of the latest masses that give the usual standard deviation of a mass, and largest relative
# difference of these masses from it.
_RECENT, _NEAR = 500, 0.2
_RATED = 6  # number of the latest items whose times give the throughput
_MOMENT = NANOSECONDS // 2  # time in ns over which the load is averaged
_PARTS = 6  # number of parts of the latest second whose mean loads are compared
_AROUND = 3 * NANOSECONDS // 10  # margin in ns before the first and after the last edge of an item


Span = tuple[int, int]  # start and end in ns


@dataclass(frozen=True, slots=True)
class BeltNoise:
    """Standard deviation in g of the signal of the empty belt, received at `stamp` in ns."""

    stamp: int
    grams: float


@dataclass(frozen=True, slots=True)
class Deed:
    """Action that a user performed on the page at `stamp` in ns."""

    stamp: int
    who: str
    what: str


@dataclass(frozen=True, slots=True, eq=False)
class ShownItem(NanEqual):
    """Item with the data that the page shows.

    A value is None or NaN if it is unknown, has not arrived, or is no longer held. `window` and
    `stretch` are None until `with_signals` adds them.
    """

    verdict: Verdict
    estimate: MassEstimate | None = None
    window: WeighWindow | None = None
    stretch: Stretch | None = None
    t4: int | None = None
    reference: float = math.nan  # kg
    usual_speed: float = math.nan  # latest known belt speed in m/s of the items before this item

    @property
    def key(self) -> Key:
        """Key of the item, which is unique if t1 or t3 is known."""
        return _key(self.verdict)

    @property
    def times(self) -> dict[str, int]:
        """Known times of the item in ns, by the names t1 to t4."""
        t1, t3 = self.key
        t2 = None if self.estimate is None else self.estimate.t2
        times = {'t1': t1, 't2': t2, 't3': t3, 't4': self.t4}
        return {name: stamp for name, stamp in times.items() if stamp is not None}


class Lane:
    """Latest records of a lane, with the samples of the last `held` s.

    The ROS thread adds records, and the page thread reads them. `version` is increased by each
    record other than samples and belt noise. `statistics`, `filler`, `load_cell` and `zero` are the
    latest records of their type, or None if no such record has arrived. `stop` is None if no stop
    request has arrived, or if it was withdrawn.
    """

    def __init__(self, name: str, held: float = SHOWN) -> None:
        self.name = name
        self.held = held
        self.version = 0
        # time.monotonic() in s at the arrival of the latest verdict, -inf before the first one.
        self.judged = -math.inf
        # Number of estimates since the line was started, also of those without a mass.
        self.weighed = 0
        self.statistics: Statistics | None = None
        self.filler: FillerFeedback | None = None
        self.stop: StopRequest | None = None
        self.alarms: tuple[Alarm, ...] = ()
        self.over: tuple[Alarm, ...] = ()  # ended alarms, which have left `alarms`
        self.load_cell: LoadCell | None = None
        self.zero: ZeroChange | None = None
        self.series = MassSeries()
        self._lock = threading.Lock()
        self._blocks: deque[SampleBlock] = deque()
        self._latest: dict[type, deque[Any]] = {
            Verdict: deque(maxlen=_MAX_HOUR),
            MassEstimate: deque(maxlen=_MAX_HOUR),
            BeltNoise: deque(maxlen=_MAX_HOUR),
            Deed: deque(maxlen=MAX_ITEMS),
            ZeroChange: deque(maxlen=MAX_ITEMS),
            WeighWindow: deque(maxlen=_MAX_WINDOWS),
            Reference: deque(maxlen=_MAX_WINDOWS),
            EyeEdge: deque(maxlen=_MAX_EDGES),
        }

    def take(self, record: Any) -> None:
        """Add a record of the lane. The record None withdraws the stop request."""
        with self._lock:
            if isinstance(record, SampleBlock):
                self._take_block(record)
                return
            if type(record) in self._latest:
                self._latest[type(record)].append(record)
            match record:
                case Verdict():
                    self.judged = time.monotonic()
                    self.series = self.series.with_item(record)
                case MassEstimate():
                    self.weighed += 1
                case Statistics():
                    self.statistics = record
                case FillerFeedback():
                    self.filler = record
                case Alarms():
                    self._take_alarms(record.alarms)
                case ZeroChange():
                    self.zero = record
                case StopRequest() | None:
                    self.stop = record
                case LoadCell():
                    self._take_load_cell(record)
                case BeltNoise():  # Belt noise alone must not update the views each second.
                    return
            self.version += 1

    def _take_load_cell(self, record: LoadCell) -> None:
        """Add the load cell of a new stream, which begins with each start of the line."""
        if self.load_cell is not None:
            self.weighed = 0
        self.load_cell = record
        self._begin_stream()

    def _take_alarms(self, alarms: tuple[Alarm, ...]) -> None:
        listed = {each.key for each in alarms}
        gone = (each for each in self.alarms if each.key not in listed)
        self.over = (*self.over, *gone)[-_MAX_OVER:]
        self.alarms = alarms

    def _take_block(self, block: SampleBlock) -> None:
        blocks = self._blocks
        if blocks and block.stamp < blocks[-1].stamp:
            self._begin_stream()
        blocks.append(block)
        while blocks[0].stamp < block.stamp - self.held * NANOSECONDS:
            blocks.popleft()

    def _begin_stream(self) -> None:
        """Drop samples, edges and reference masses.

        Records of the previous stream must not be mixed with records of a new stream, whose stamps
        may be earlier.
        """
        for records in (self._blocks, self._latest[EyeEdge], self._latest[Reference]):
            records.clear()

    def forget_signals(self) -> None:
        """Drop samples and windows, because without a viewer the page receives no newer ones."""
        with self._lock:
            self._blocks.clear()
            self._latest[WeighWindow].clear()

    def items(self, span: Span | None = None) -> list[ShownItem]:
        """Return the items, or only those in a span, without their signals, the latest item first.

        Only the latest `MAX_ITEMS` of these items are returned.
        """
        verdicts, estimates, edges, references = self._of(Verdict, MassEstimate, EyeEdge, Reference)
        if span is None:  # The latest estimates suffice for the latest verdicts.
            estimates = estimates[-2 * MAX_ITEMS :]
        else:
            verdicts = tuple(each for each in verdicts if is_within(each, span))
        # A restarted lane may repeat its latest verdicts, so keep one verdict of each item.
        latest = {(each.item_id, _key(each)): each for each in verdicts[-MAX_ITEMS:]}
        by_key = {_key(estimate): estimate for estimate in estimates}
        results = [(verdict, by_key.get(_key(verdict))) for verdict in latest.values()]
        joiner = ResultJoiner(edges, references)
        return list(joined(results, joiner))[::-1]

    def faults(self, span: Span | None = None) -> list[ShownItem]:
        """Return the items of `items(span)` with the decision FAULT, the latest item first."""
        return [each for each in self.items(span) if each.verdict.decision == Decision.FAULT]

    def history(self) -> History:
        """Return the latest items, belt noise, changes of zero, and actions of users."""
        verdicts, estimates, noise, deeds, zeros = self._of(
            Verdict, MassEstimate, BeltNoise, Deed, ZeroChange
        )
        zero_of = {_key(each): each.zero for each in estimates}
        items = ((verdict, zero_of.get(_key(verdict), math.nan)) for verdict in verdicts)
        changes = [
            (each.stamp, Text('{name}: {deed}', name=each.who, deed=each.what)) for each in deeds
        ]
        changes += [
            (each.stamp, Text('zero {mass}', mass=Mass(round(each.zero, 5)))) for each in zeros
        ]
        return history_of(items, ((each.stamp, each.grams) for each in noise), changes)

    def last_estimate(self) -> MassEstimate | None:
        """Return the latest estimate, or None if none has arrived."""
        with self._lock:
            estimates = self._latest[MassEstimate]
            return estimates[-1] if estimates else None

    def throughput(self) -> float:
        """Return the items per minute, by the median time between the latest six.

        Returns NaN if fewer than two items are known, or if no item has come for some time.
        """
        with self._lock:
            latest = list(islice(reversed(self._latest[Verdict]), _RATED))
        times = sorted(each.t1 for each in latest if each.t1 is not None)
        interval = median(b - a for a, b in pairwise(times)) if len(times) > 1 else 0
        if interval <= 0:
            return math.nan
        since = NANOSECONDS * (time.monotonic() - self.judged)
        return _MINUTE / interval if since < _RATED * interval else math.nan

    def usual_std_dev(self, mass: float) -> float:
        """Return the median of the standard deviations of the latest masses close to `mass`, in kg.

        Returns 0 if none is known. Only masses since the start of the line count, because a line
        that was trained states other standard deviations after its next start.
        """
        with self._lock:
            count = min(_RECENT, self.weighed)
            latest = list(islice(reversed(self._latest[MassEstimate]), count))
        near = [each.std_dev for each in latest if abs(each.mass - mass) <= _NEAR * mass]
        known = [each for each in near if math.isfinite(each)]
        return median(known) if known else 0.0

    def _of(self, *kinds: type) -> list[tuple[Any, ...]]:
        with self._lock:
            return [tuple(self._latest[kind]) for kind in kinds]

    def _signal(self) -> RawSignal | None:
        """Return the samples and edges, or None if no load cell or no samples have arrived."""
        with self._lock:
            cell, blocks, edges = self.load_cell, list(self._blocks), list(self._latest[EyeEdge])
        return RawSignal(cell, blocks, edges) if cell is not None and blocks else None

    def with_signals(self, item: ShownItem) -> ShownItem:
        """Return an item with its window and raw samples, as `with_window` does."""
        (windows,) = self._of(WeighWindow)
        window = next((each for each in reversed(windows) if _key(each) == item.key), None)
        return with_window(item, window, self._signal())

    def windows_before(self, item: ShownItem, count: int) -> list[WeighWindow]:
        """Return the windows of at most `count` items of the same product before an item.

        The latest window is the last one. Windows without samples are left out.
        """
        verdicts, windows = self._of(Verdict, WeighWindow)
        own = {_key(each) for each in verdicts[-MAX_ITEMS:] if each.product == item.verdict.product}
        end = max(item.times.values(), default=0)
        known = [each for each in windows if _key(each) in own and len(each.counts)]
        return [each for each in known if (each.t3 or 0) < end][-count:]

    def empty_belt(self, item: ShownItem | None = None) -> NDArray[np.float64]:
        """Return the signal of the longest segment with an empty belt, shape (n,), in kg.

        The mean of the signal is subtracted. The segment is within the last `SHOWN` s. The array is
        empty if there are no samples. `item` is ignored, because only the latest samples are held.
        """
        signal = self._signal()
        if signal is None:
            return np.zeros(0)
        end = signal.blocks[-1].stamp
        return signal.empty_belt(end - round(SHOWN * NANOSECONDS), end)

    def load(self) -> tuple[float, float]:
        """Return the present load on the belt and its range within the latest 1 s, in kg.

        The load is the mean over the latest 0.5 s, relative to the zero of calibration. The range
        is the largest minus the smallest mean of the `_PARTS` parts of the latest 1 s. Load and
        range are NaN if no load cell or no samples have arrived.
        """
        signal = self._signal()
        if signal is None:
            return math.nan, math.nan
        cell, begin = signal.load_cell, signal.blocks[-1].stamp - 2 * _MOMENT
        counts = np.concatenate([each.counts for each in signal.blocks if each.stamp >= begin])
        means = np.array([part.mean() for part in np.array_split(counts, min(_PARTS, len(counts)))])
        loads = (means - cell.zero_counts) / cell.counts_per_kg
        return float(loads[len(loads) // 2 :].mean()), float(np.ptp(loads))

    def recording(self) -> Recording | None:
        """Return the samples and edges of the period for which the lane holds both.

        The recording also contains the known masses that were published in this period. Returns
        None if the lane holds no samples of a period in which it also holds all edges.
        """
        (references,) = self._of(Reference)
        signal = self._signal()
        if signal is None:
            return None
        begin, edges = signal.blocks[0].stamp, signal.edges
        # Begin at the first edge if earlier edges may have been dropped.
        if len(edges) == _MAX_EDGES:
            begin = max(begin, edges[0].stamp)
        if signal.blocks[-1].stamp < begin:
            return None
        events: tuple[Event, ...] = (*signal.blocks, *edges, *references)
        return Recording.from_events(signal.load_cell, (e for e in events if e.stamp >= begin))


def is_within(verdict: Verdict, span: Span) -> bool:
    """Return whether the time of an item is known and is in a span."""
    return verdict.time is not None and span[0] <= verdict.time <= span[1]


def joined(
    results: Iterable[tuple[Verdict, MassEstimate | None]], joiner: ResultJoiner
) -> Iterator[ShownItem]:
    """Yield an item without signals for each pair of verdict and estimate, in the same order.

    The pairs must be in the order of the items on the line, because the usual speed of an item is
    the latest known speed of the items before it.
    """
    speed = math.nan
    for verdict, estimate in results:
        nothing = MassEstimate(verdict.item_id, verdict.t1, None, verdict.t3, verdict.reasons)
        known = joiner.join(Weighing(estimate or nothing, verdict))
        yield ShownItem(verdict, estimate, None, None, known.t4, known.reference, speed)
        if estimate is not None and math.isfinite(estimate.belt_speed):
            speed = estimate.belt_speed


def with_window(item: ShownItem, window: WeighWindow | None, signal: RawSignal | None) -> ShownItem:
    """Return an item with its window.

    The raw samples around the item are added if the item is a fault, or if its window is None or
    has no samples. No raw samples are added if they are no longer held, or if no time of the item
    is known.
    """
    item = replace(item, window=window)
    weighed = item.verdict.decision != Decision.FAULT
    if signal is None or not item.times or (weighed and window is not None and len(window.counts)):
        return item
    return replace(item, stretch=signal.stretch(*_span_of(item, signal.load_cell)))


def _span_of(item: ShownItem, load_cell: LoadCell) -> tuple[int, int]:
    """Return the start and end in ns of the signal around an item.

    If an eye missed the item, the time at that eye is computed from the usual belt speed, if this
    speed is known.
    """
    times, speed = item.times.values(), item.usual_speed
    begin, end = min(times), max(times)
    if speed > 0 and None in item.key:
        transit = round(NANOSECONDS * load_cell.weigh_length / speed)
        begin, end = min(begin, end - transit), max(end, begin + transit)
    return begin - _AROUND, end + _AROUND


def _key(record: Verdict | MassEstimate | WeighWindow) -> Key:
    return record.t1, record.t3
