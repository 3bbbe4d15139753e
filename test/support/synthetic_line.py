# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Synthetic lines and windows whose truth is known by construction."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, SampleBlock, WeighWindow
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter
from checkweigher_dsp.signal.platform_response import Crossing, Platform, responses

START = 1_700_000_000 * NANOSECONDS
CELL = LoadCell(
    sample_rate=960.0, counts_per_kg=1e6, zero_counts=5000.0, min_counts=-(2**23),
    max_counts=2**23 - 1, capacity=7.2, weigh_length=0.2,
)  # fmt: skip
MILLI = replace(CELL, sample_rate=1000.0)  # a sample each millisecond


@dataclass(frozen=True)
class Product:
    """A product that crosses the belt: its four edges by name, stamps in ns, and its mass in kg."""

    mass: float
    t1: int
    t2: int
    t3: int
    t4: int

    @property
    def edges(self):
        return {
            't1': EyeEdge(self.t1, Eye.INFEED, True),
            't2': EyeEdge(self.t2, Eye.INFEED, False),
            't3': EyeEdge(self.t3, Eye.OUTFEED, True),
            't4': EyeEdge(self.t4, Eye.OUTFEED, False),
        }


@dataclass(frozen=True)
class SyntheticLine:
    """Products on a noise-free line: the load of each rises, stands from t2 to t3 and falls."""

    load_cell: LoadCell
    products: tuple[Product, ...]
    counts: np.ndarray
    start: int

    def edges(self, without=()):
        """Edges in time; `without` are pairs of product, counted from 0, and edge name."""
        edges = [
            edge
            for number, product in enumerate(self.products)
            for name, edge in product.edges.items()
            if (number, name) not in without
        ]
        return sorted(edges, key=lambda edge: edge.stamp)

    def stamp_at(self, index):
        return self.start + round(index * NANOSECONDS / self.load_cell.sample_rate)

    def blocks(self, size=32, cuts=None, lost=(0, 0)):
        """Blocks of `size` samples, or cut at the indices `cuts`; [lost[0], lost[1]) is missing."""
        end = len(self.counts)
        cuts = {*(range(0, end, size) if cuts is None else cuts), 0, end, *lost}
        bounds = pairwise(sorted(cuts))
        return [
            SampleBlock(self.stamp_at(begin), begin, self.counts[begin:to])
            for begin, to in bounds
            if not lost[0] <= begin < lost[1]
        ]

    def events(self, without=(), edges=None, **blocks):
        """Blocks and edges in the order of their last stamp; `edges` in place of its own."""
        timed = [
            (self.stamp_at(block.first_index + len(block.counts)), block)
            for block in self.blocks(**blocks)
        ]
        edges = self.edges(without) if edges is None else edges
        timed += [(edge.stamp, edge) for edge in edges]
        return [event for _, event in sorted(timed, key=lambda pair: pair[0])]


def make_line(
    masses=(0.1, 0.2, 0.3),
    speed=1.0,
    spacing=0.6,
    length=0.1,
    first_entry=1.0,
    after=1.0,
    load_cell=CELL,
    start=START,
):
    """Build a line; `spacing` in m, one for all or one for each product but the last."""
    gaps = [spacing] * (len(masses) - 1) if isinstance(spacing, float) else list(spacing)
    entries = first_entry + np.cumsum([0.0, *gaps]) / speed
    seconds = entries[-1] + (load_cell.weigh_length + length) / speed + after
    time = np.arange(int(seconds * load_cell.sample_rate)) / load_cell.sample_rate
    load = np.zeros(len(time))
    products = []
    for mass, entry in zip(masses, entries, strict=True):
        ways = np.array([0, length, load_cell.weigh_length, load_cell.weigh_length + length])
        times = entry + ways / speed
        load += mass * np.interp(time, times, [0, 1, 1, 0])
        products.append(Product(mass, *(start + round(t * NANOSECONDS) for t in times)))
    counts = np.round(load_cell.zero_counts + load_cell.counts_per_kg * load).astype(np.int32)
    return SyntheticLine(load_cell, tuple(products), counts, start)


def feed(segmenter, events):
    """Feed events to a segmenter and return the windows."""
    return [window for event in events for window in segmenter.take(event)]


def run_segmenter(segmenter, events):
    """Feed events to a segmenter and return the windows, those of the end included."""
    return feed(segmenter, events) + segmenter.finish()


def cut(line, parameters=SegmenterParameters(), events=None, **of_line):
    """Return the windows of a line, which come in the order of their items."""
    events = line.events(**of_line) if events is None else events
    windows = run_segmenter(Segmenter(line.load_cell, parameters), events)
    assert [window.item_id for window in windows] == list(range(1, len(windows) + 1))
    return windows


def reasons_of(windows):
    """Return the reasons of each window."""
    return [list(window.reasons) for window in windows]


def make_window(force, lead=0, counts_per_kg=1e6, zero=5000.0, **fields):
    """Build a window of t2..t3 in which `force` (kg) stands, after `lead` samples of empty belt."""
    counts = np.round(
        zero + counts_per_kg * np.concatenate([np.zeros(lead), np.asarray(force)])
    ).astype(np.int32)
    values = {
        'item_id': 1, 't1': 0, 't2': 100_000_000, 't3': 200_000_000, 'belt_speed': 1.0,
        'product_length': 0.1, 'line_speed': 1.0, 'sample_rate': 960.0,
        'counts_per_kg': counts_per_kg, 'zero_counts': zero, 'zero': zero, 'zero_std_dev': 0.0,
        'window_begin': lead, 'window_end': len(counts), 'counts': counts,
    }  # fmt: skip
    return WeighWindow(**{**values, **fields})


PLATFORM = Platform(38.0, 0.06, 2.5)


def make_pass(
    mass=0.2, before=0.45, trail=0.0, disturbance=None, old=(0.0, 0.0), impact=(0.0, 0.0),
    platform=PLATFORM, **fields,
):  # fmt: skip
    """Build the window of a product of 0.1 m that rides at 1 m/s over a belt of 0.2 m.

    `old` and `impact` are what the product before and the entry leave: amplitudes in kg of the
    two free oscillations of `responses`. `disturbance` (kg) is a function of the time since t1.
    Counts are 1e-9 kg, so that their rounding is.
    """
    t1, rate = START, 960.0
    stamp = t1 - round(before * NANOSECONDS)
    count = int((before + 0.2 + trail) * rate)
    time = (stamp - t1) / NANOSECONDS + np.arange(count) / rate
    # The oscillations need a sample before t1, whether the window has one or not.
    grid = np.concatenate([[-1.0], time])
    rows = responses(platform, mass, Crossing(0.0, 0.1, 0.2, 0.3), grid)[:, 1:]
    force = np.array([mass, *old, *impact]) @ rows
    if disturbance is not None:
        force = force + disturbance(time)
    values = {
        't1': t1, 't2': t1 + 100_000_000, 't3': t1 + 200_000_000, 'stamp': stamp,
        'window_begin': int(np.sum(time < 0.1)), 'window_end': int(np.sum(time < 0.2)),
    }  # fmt: skip
    return make_window(force, counts_per_kg=1e9, zero=0.0, **{**values, **fields})
