# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the page knows of a lane: the latest items with their signals, and what the line said."""

from bisect import bisect_right
from collections import OrderedDict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
import math
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import Event, Recording
from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    FillerFeedback,
    LoadCell,
    MassEstimate,
    Reference,
    SampleBlock,
    Statistics,
    StopRequest,
    Verdict,
    WeighWindow,
)
from checkweigher_validation.accuracy.results import ResultJoiner
from checkweigher_web.mass_series import MassSeries

MAX_ITEMS = 500
_MAX_WINDOWS = 50
_MAX_EDGES = 400
SHOWN = 20.0  # s of samples, which the views need
_MOMENT = NANOSECONDS // 2  # over which a load is averaged
_AROUND = 3 * NANOSECONDS // 10  # before the first and after the last edge of an item

# Of an item: numbers begin at 1 again where a node is started again, stamps do not.
Key = tuple[int | None, int | None]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Raw samples with the edges among them; `time` (n,) in ns, `counts` (n,)."""

    time: NDArray[np.int64]
    counts: NDArray[np.int32]
    edges: tuple[EyeEdge, ...] = ()


@dataclass(frozen=True, slots=True)
class Item:
    """One item; what has not come is None or NaN."""

    verdict: Verdict
    estimate: MassEstimate | None = None
    window: WeighWindow | None = None
    stretch: Stretch | None = None
    t4: int | None = None
    reference: float = math.nan  # kg
    usual_speed: float = math.nan  # m/s, of the last item before whose speed is known

    @property
    def key(self) -> Key:
        """Key of the item, which no other one has."""
        return _key(self.verdict)


class Lane:
    """The latest of a lane, by its records.

    Records come in the thread of ROS and are read in that of the page. `version` grows with each
    record that a page shows. It holds the samples of the last `held` s.
    """

    def __init__(self, name: str, held: float = SHOWN) -> None:
        self.name = name
        self.held = held
        self.version = 0
        self.statistics: Statistics | None = None
        self.filler: FillerFeedback | None = None
        self.stop: StopRequest | None = None
        self.load_cell: LoadCell | None = None
        self.series = MassSeries()
        self._lock = threading.Lock()
        self._verdicts: deque[Verdict] = deque(maxlen=MAX_ITEMS)
        self._estimates: OrderedDict[Key, MassEstimate] = OrderedDict()
        self._windows: OrderedDict[Key, WeighWindow] = OrderedDict()
        self._references: deque[Reference] = deque(maxlen=_MAX_WINDOWS)
        self._edges: deque[EyeEdge] = deque(maxlen=_MAX_EDGES)
        self._blocks: deque[SampleBlock] = deque()

    def take(self, record: Any) -> None:
        """Take a record of the lane."""
        with self._lock:
            match record:
                case SampleBlock():
                    self._take_block(record)
                    return
                case Verdict():
                    self._verdicts.append(record)
                    self.series = self.series.with_item(record)
                case MassEstimate():
                    _remember(self._estimates, record, MAX_ITEMS)
                case WeighWindow():
                    _remember(self._windows, record, _MAX_WINDOWS)
                case Reference():
                    self._references.append(record)
                case EyeEdge():
                    self._edges.append(record)
                case Statistics():
                    self.statistics = record
                case FillerFeedback():
                    self.filler = record
                case LoadCell():  # what a source sends first
                    self.load_cell = record
                    self._begin_stream()
            self.version += 1

    def take_stop(self, stop: StopRequest | None) -> None:
        """Take what the lane says of a stop: the request, or None where it may run."""
        with self._lock:
            self.stop = stop
            self.version += 1

    def _take_block(self, block: SampleBlock) -> None:
        blocks = self._blocks
        if blocks and block.stamp < blocks[-1].stamp:
            self._begin_stream()
        blocks.append(block)
        while blocks[0].stamp < block.stamp - self.held * NANOSECONDS:
            blocks.popleft()

    def _begin_stream(self) -> None:
        """Forget what the source has sent: its stamps may begin again, and would be mixed up."""
        self._blocks.clear()
        self._edges.clear()
        self._references.clear()

    def forget_signals(self) -> None:
        """Forget samples and windows: nobody looks, and what comes next would not follow them."""
        with self._lock:
            self._blocks.clear()
            self._windows.clear()

    def items(self) -> list[Item]:
        """Return the items without their signals, the latest first."""
        with self._lock:
            verdicts, estimates = list(self._verdicts), dict(self._estimates)
            joiner = ResultJoiner(tuple(self._edges), tuple(self._references))
        found, speed = [], math.nan
        for verdict in verdicts:
            estimate = estimates.get(_key(verdict))
            known = joiner.join(estimate or _nothing(verdict), verdict)
            found.append(Item(verdict, estimate, None, None, known.t4, known.reference, speed))
            if estimate is not None and math.isfinite(estimate.belt_speed):
                speed = estimate.belt_speed
        return found[::-1]

    def faults(self) -> list[Item]:
        """Return the faults among the items, the latest first."""
        return [item for item in self.items() if item.verdict.decision == Decision.FAULT]

    def with_signals(self, item: Item) -> Item:
        """Return an item with its window; a fault, and what has none, with the samples around."""
        with self._lock:
            window, load_cell = self._windows.get(item.key), self.load_cell
        stretch = None
        if needs_stretch(item, window) and load_cell is not None:
            span = span_of(item, load_cell)
            stretch = None if span is None else self.stretch(*span)
        return replace(item, window=window, stretch=stretch)

    def stretch(self, begin: int, end: int) -> Stretch | None:
        """Return the raw signal from `begin` to `end`, ns; None without a sample there."""
        with self._lock:
            load_cell, blocks, edges = self.load_cell, list(self._blocks), list(self._edges)
        if load_cell is None:
            return None
        stamps = [block.stamp for block in blocks]
        among = slice(max(bisect_right(stamps, begin) - 1, 0), bisect_right(stamps, end))
        return stretch_of(load_cell, blocks[among], edges, begin, end)

    def empty_belt(self) -> NDArray[np.float64]:
        """Return the longest stretch without an item among the samples, (n,) kg."""
        with self._lock:
            load_cell, edges, blocks = self.load_cell, list(self._edges), list(self._blocks)
        if load_cell is None or not blocks:
            return np.zeros(0)
        since = blocks[-1].stamp - SHOWN * NANOSECONDS
        return emptiest(load_cell, [each for each in blocks if each.stamp >= since], edges)

    def load(self) -> float:
        """Return what rests on the belt now by its calibration, kg; NaN without samples."""
        with self._lock:
            cell, blocks = self.load_cell, list(self._blocks)
        if cell is None or not blocks:
            return math.nan
        begin = blocks[-1].stamp - _MOMENT
        counts = np.concatenate([block.counts for block in blocks if block.stamp >= begin])
        return float((counts.mean() - cell.zero_counts) / cell.counts_per_kg)

    def recording(self) -> Recording | None:
        """Return what is held of samples and edges, from where on there are both, if anywhere."""
        with self._lock:
            load_cell, blocks = self.load_cell, list(self._blocks)
            edges, references = list(self._edges), list(self._references)
        if load_cell is None or not blocks:
            return None
        begin = blocks[0].stamp
        if len(edges) == _MAX_EDGES:  # those before are forgotten
            begin = max(begin, edges[0].stamp)
        if blocks[-1].stamp < begin:
            return None
        events: tuple[Event, ...] = (*blocks, *edges, *references)
        return Recording.from_events(load_cell, (e for e in events if e.stamp >= begin))


def stretch_of(
    load_cell: LoadCell, blocks: Sequence[SampleBlock], edges: Iterable[EyeEdge],
    begin: int, end: int,
) -> Stretch | None:  # fmt: skip
    """Return the raw signal from `begin` to `end`, ns; None without a sample there."""
    if not blocks:
        return None
    period = NANOSECONDS / load_cell.sample_rate
    time = np.concatenate(
        [block.stamp + (np.arange(len(block.counts)) * period).astype(int) for block in blocks]
    )
    counts = np.concatenate([block.counts for block in blocks])
    inside = (begin <= time) & (time <= end)
    if not inside.any():
        return None
    among = tuple(edge for edge in edges if begin <= edge.stamp <= end)
    return Stretch(time[inside], counts[inside], among)


def emptiest(
    load_cell: LoadCell, blocks: Sequence[SampleBlock], edges: Iterable[EyeEdge]
) -> NDArray[np.float64]:
    """Return the longest stretch without an item, (n,) kg without its mean."""
    if not blocks:
        return np.zeros(0)
    ordered = sorted(edges, key=lambda edge: edge.stamp)
    gap = longest_gap(ordered, blocks[0].stamp, blocks[-1].stamp)
    found = stretch_of(load_cell, blocks, (), *gap)
    if found is None:
        return np.zeros(0)
    force = found.counts / load_cell.counts_per_kg
    return np.asarray(force - force.mean())


def needs_stretch(item: Item, window: WeighWindow | None) -> bool:
    """Tell whether the signal around an item shows more of it than its window."""
    weighed = item.verdict.decision != Decision.FAULT
    return not weighed or window is None or not len(window.counts)


def span_of(item: Item, load_cell: LoadCell) -> tuple[int, int] | None:
    """Return the time in which an item was, or should have been, at the eyes, with some around.

    In ns; None for an item of which no time is known.
    """
    known, stamps = item.estimate, [*item.key, item.t4]
    stamps += [known.t2] if known is not None else []
    times = [stamp for stamp in stamps if stamp is not None]
    if not times:
        return None
    begin, end = min(times), max(times)
    speed = item.usual_speed
    if speed > 0 and None in item.key:
        transit = round(NANOSECONDS * load_cell.weigh_length / speed)
        begin, end = min(begin, end - transit), max(end, begin + transit)
    return begin - _AROUND, end + _AROUND


def longest_gap(edges: Iterable[EyeEdge], begin: int, end: int) -> tuple[int, int]:
    """Return the longest time from an item that has left to the next one that enters, ns."""
    longest, since = (begin, begin), begin
    for edge in edges:
        if edge.eye == Eye.INFEED and edge.blocked:
            if edge.stamp - since > longest[1] - longest[0]:
                longest = since, edge.stamp
            since = end  # until it has left
        elif edge.eye == Eye.OUTFEED and not edge.blocked:
            since = max(edge.stamp, begin)
    return (since, end) if end - since > longest[1] - longest[0] else longest


def _key(record: Verdict | MassEstimate | WeighWindow) -> Key:
    return record.t1, record.t3


def _remember(known: OrderedDict[Key, Any], record: Any, count: int) -> None:
    known[_key(record)] = record
    if len(known) > count:
        known.popitem(last=False)


def _nothing(verdict: Verdict) -> MassEstimate:
    return MassEstimate(verdict.item_id, verdict.t1, None, verdict.t3, verdict.reasons)
