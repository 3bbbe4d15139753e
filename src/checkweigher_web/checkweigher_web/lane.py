# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The latest items of a lane with their signals, and the latest messages of its nodes."""

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
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
SHOWN = 20.0  # s of samples that the views need
_MOMENT = NANOSECONDS // 2  # time over which a load is averaged, in ns
_AROUND = 3 * NANOSECONDS // 10  # ns before the first and after the last edge of an item

# t1 and t3 of an item. Its number is no key, because numbers start at 1 when a node is restarted.
Key = tuple[int | None, int | None]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Raw samples with the edges among them; `time` (n,) in ns, `counts` (n,)."""

    time: NDArray[np.int64]
    counts: NDArray[np.int32]
    edges: tuple[EyeEdge, ...] = ()


@dataclass(frozen=True, slots=True)
class Item:
    """One item; whatever has not come is None or NaN."""

    verdict: Verdict
    estimate: MassEstimate | None = None
    window: WeighWindow | None = None
    stretch: Stretch | None = None
    t4: int | None = None
    reference: float = math.nan  # kg
    usual_speed: float = math.nan  # m/s; last known speed of the items before

    @property
    def key(self) -> Key:
        """Key of the item, which is unique."""
        return _key(self.verdict)


class Lane:
    """The latest records of a lane, with the samples of the last `held` s.

    Records come in the thread of ROS and are read in the thread of the page. `version` grows with
    each record that a page shows.
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
        self._blocks: deque[SampleBlock] = deque()
        self._latest: dict[type, deque[Any]] = {
            Verdict: deque(maxlen=MAX_ITEMS),
            MassEstimate: deque(maxlen=MAX_ITEMS),
            WeighWindow: deque(maxlen=_MAX_WINDOWS),
            Reference: deque(maxlen=_MAX_WINDOWS),
            EyeEdge: deque(maxlen=_MAX_EDGES),
        }

    def take(self, record: Any) -> None:
        """Add a record of the lane; None takes its stop request back."""
        with self._lock:
            if isinstance(record, SampleBlock):
                self._take_block(record)
                return
            if type(record) in self._latest:
                self._latest[type(record)].append(record)
            match record:
                case Verdict():
                    self.series = self.series.with_item(record)
                case Statistics():
                    self.statistics = record
                case FillerFeedback():
                    self.filler = record
                case StopRequest() | None:
                    self.stop = record
                case LoadCell():  # the first message of a source
                    self.load_cell = record
                    self._begin_stream()
            self.version += 1

    def _take_block(self, block: SampleBlock) -> None:
        blocks = self._blocks
        if blocks and block.stamp < blocks[-1].stamp:
            self._begin_stream()
        blocks.append(block)
        while blocks[0].stamp < block.stamp - self.held * NANOSECONDS:
            blocks.popleft()

    def _begin_stream(self) -> None:
        """Drop the records of the source, whose stamps may start again."""
        for records in (self._blocks, self._latest[EyeEdge], self._latest[Reference]):
            records.clear()

    def forget_signals(self) -> None:
        """Drop samples and windows, because nobody looks and the next ones will not follow them."""
        with self._lock:
            self._blocks.clear()
            self._latest[WeighWindow].clear()

    def items(self) -> list[Item]:
        """Return the items without their signals, the latest first."""
        verdicts, estimates, edges, references = self._of(Verdict, MassEstimate, EyeEdge, Reference)
        by_key = {_key(estimate): estimate for estimate in estimates}
        results = [(verdict, by_key.get(_key(verdict))) for verdict in verdicts]
        joiner = ResultJoiner(edges, references)
        return list(joined(results, joiner))[::-1]

    def faults(self) -> list[Item]:
        """Return the faults among the items, the latest first."""
        return [item for item in self.items() if item.verdict.decision == Decision.FAULT]

    def _of(self, *kinds: type) -> list[tuple[Any, ...]]:
        """Return the records of some kinds."""
        with self._lock:
            return [tuple(self._latest[kind]) for kind in kinds]

    def _samples(self) -> tuple[LoadCell | None, list[SampleBlock], list[EyeEdge]]:
        """Return the load cell, and the blocks and edges that are held."""
        with self._lock:
            return self.load_cell, list(self._blocks), list(self._latest[EyeEdge])

    def with_signals(self, item: Item) -> Item:
        """Return an item with its window, or a fault with the samples around it."""
        (windows,) = self._of(WeighWindow)
        window = next((each for each in reversed(windows) if _key(each) == item.key), None)
        return with_window(item, window, self.load_cell, self.stretch)

    def stretch(self, begin: int, end: int) -> Stretch | None:
        """Return the raw signal from `begin` to `end` in ns, or None if there is no sample."""
        load_cell, blocks, edges = self._samples()
        if load_cell is None:
            return None
        stamps = [block.stamp for block in blocks]
        among = slice(max(bisect_right(stamps, begin) - 1, 0), bisect_right(stamps, end))
        return stretch_of(load_cell, blocks[among], edges, begin, end)

    def empty_belt(self) -> NDArray[np.float64]:
        """Return the longest part of the signal without an item: (n,) in kg."""
        load_cell, blocks, edges = self._samples()
        if load_cell is None or not blocks:
            return np.zeros(0)
        since = blocks[-1].stamp - SHOWN * NANOSECONDS
        return emptiest(load_cell, [each for each in blocks if each.stamp >= since], edges)

    def load(self) -> float:
        """Return the present load on the belt in kg; NaN without samples."""
        load_cell, blocks, _ = self._samples()
        if load_cell is None or not blocks:
            return math.nan
        begin = blocks[-1].stamp - _MOMENT
        counts = np.concatenate([block.counts for block in blocks if block.stamp >= begin])
        return float((counts.mean() - load_cell.zero_counts) / load_cell.counts_per_kg)

    def recording(self) -> Recording | None:
        """Return the samples and edges that are held, from the first time with both; or None."""
        (references,) = self._of(Reference)
        load_cell, blocks, edges = self._samples()
        if load_cell is None or not blocks:
            return None
        begin = blocks[0].stamp
        if len(edges) == _MAX_EDGES:  # earlier ones were dropped
            begin = max(begin, edges[0].stamp)
        if blocks[-1].stamp < begin:
            return None
        events: tuple[Event, ...] = (*blocks, *edges, *references)
        return Recording.from_events(load_cell, (e for e in events if e.stamp >= begin))


def joined(
    results: Iterable[tuple[Verdict, MassEstimate | None]], joiner: ResultJoiner
) -> Iterator[Item]:
    """Yield an item for each verdict and its estimate, in the order of the line."""
    speed = math.nan
    for verdict, estimate in results:
        nothing = MassEstimate(verdict.item_id, verdict.t1, None, verdict.t3, verdict.reasons)
        known = joiner.join(estimate or nothing, verdict)
        yield Item(verdict, estimate, None, None, known.t4, known.reference, speed)
        if estimate is not None and math.isfinite(estimate.belt_speed):
            speed = estimate.belt_speed


def with_window(
    item: Item,
    window: WeighWindow | None,
    load_cell: LoadCell | None,
    stretch: Callable[[int, int], Stretch | None],
) -> Item:
    """Return an item with its window, and with the samples around it if they show more.

    `stretch` returns the raw signal between two stamps in ns.
    """
    item = replace(item, window=window)
    weighed = item.verdict.decision != Decision.FAULT
    if load_cell is None or (weighed and window is not None and len(window.counts)):
        return item
    span = span_of(item, load_cell)
    return item if span is None else replace(item, stretch=stretch(*span))


def stretch_of(
    load_cell: LoadCell,
    blocks: Sequence[SampleBlock],
    edges: Iterable[EyeEdge],
    begin: int,
    end: int,
) -> Stretch | None:
    """Return the raw signal from `begin` to `end` in ns, or None if there is no sample."""
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
    """Return the longest part of the signal without an item: (n,) in kg, without its mean."""
    if not blocks:
        return np.zeros(0)
    ordered = sorted(edges, key=lambda edge: edge.stamp)
    gap = longest_gap(ordered, blocks[0].stamp, blocks[-1].stamp)
    found = stretch_of(load_cell, blocks, (), *gap)
    if found is None:
        return np.zeros(0)
    force = found.counts / load_cell.counts_per_kg
    return np.asarray(force - force.mean())


def span_of(item: Item, load_cell: LoadCell) -> tuple[int, int] | None:
    """Return begin and end of the signal around an item in ns; None if none of its times is known.

    For an item that one eye missed the time at that eye is estimated from the usual speed.
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
    """Return the longest time without an item on the belt, in ns."""
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
