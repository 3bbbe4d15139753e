# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the page knows of a lane: the latest items with their signals, and what the line said."""

from collections import OrderedDict, deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
import math
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.records import (
    NANOSECONDS,
    Eye,
    EyeEdge,
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

MAX_ITEMS = 500
_MAX_WINDOWS = 50
_MAX_EDGES = 400
_KEPT = 20 * NANOSECONDS  # of samples
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

    @property
    def key(self) -> Key:
        """Key of the item, which no other one has."""
        return _key(self.verdict)


class Lane:
    """The latest of a lane, by its records.

    Records come in the thread of ROS and are read in that of the page. `version` grows with each
    record that a page shows.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.version = 0
        self.statistics: Statistics | None = None
        self.stop: StopRequest | None = None
        self.load_cell: LoadCell | None = None
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
                case StopRequest():
                    self.stop = record
                case LoadCell():
                    self.load_cell = record
            self.version += 1

    def _take_block(self, block: SampleBlock) -> None:
        blocks = self._blocks
        if blocks and block.stamp < blocks[-1].stamp:
            blocks.clear()  # the source has begun again
        blocks.append(block)
        while blocks[0].stamp < block.stamp - _KEPT:
            blocks.popleft()

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
        found = []
        for verdict in reversed(verdicts):
            estimate = estimates.get(_key(verdict))
            known = joiner.join(estimate or _nothing(verdict), verdict)
            found.append(Item(verdict, estimate, t4=known.t4, reference=known.reference))
        return found

    def with_signals(self, item: Item) -> Item:
        """Return an item with its window, or with the samples around what has none."""
        with self._lock:
            window = self._windows.get(item.key)
        stretch = None
        stamps = [stamp for stamp in (*item.key, item.t4) if stamp is not None]
        if (window is None or not len(window.counts)) and stamps:
            stretch = self.stretch(min(stamps) - _AROUND, max(stamps) + _AROUND)
        return replace(item, window=window, stretch=stretch)

    def stretch(self, begin: int, end: int) -> Stretch | None:
        """Return the raw signal from `begin` to `end`, ns; None without a sample there."""
        with self._lock:
            load_cell, blocks, edges = self.load_cell, list(self._blocks), list(self._edges)
        if load_cell is None or not blocks:
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

    def empty_belt(self) -> NDArray[np.float64]:
        """Return the longest stretch without an item among the samples, (n,) kg."""
        with self._lock:
            edges, blocks = sorted(self._edges, key=lambda edge: edge.stamp), list(self._blocks)
        if not blocks or self.load_cell is None:
            return np.zeros(0)
        begin, end = longest_gap(edges, blocks[0].stamp, blocks[-1].stamp)
        found = self.stretch(begin, end)
        if found is None:
            return np.zeros(0)
        force = found.counts / self.load_cell.counts_per_kg
        return np.asarray(force - force.mean())


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
