# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Health of the line as the segmenter sees it: samples, clock, eyes, zero, noise, items."""

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.health.stream import PATIENCE, EyeWatch, SampleWatch
from checkweigher_core.records import NANOSECONDS, EyeEdge, LoadCell, SampleBlock, WeighWindow
from checkweigher_dsp.health.edges import edges_finding
from checkweigher_dsp.health.items import FaultWatch
from checkweigher_dsp.health.scale import BeltNoiseWatch, ZeroWatch
from checkweigher_dsp.segmentation.edge_check import EdgeCheck
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter


class SegmenterWatch:
    """Follow what goes into the segmenter and what comes out, since the node `began`, s."""

    def __init__(self, parameters: SegmenterParameters, began: float) -> None:
        self._parameters = parameters
        self._began = began
        self._load_cell: LoadCell | None = None
        self._samples: SampleWatch  # from the first load cell on, as the two below
        self._zero: ZeroWatch
        self._noise: BeltNoiseWatch
        self._eyes = EyeWatch()
        self._edge_check: EdgeCheck | None = None
        self._items = FaultWatch()
        self._end: tuple[bool, str] | None = None  # whether the stream ended well, what was said
        self._stream_began = began

    def begin_stream(self, now: float, load_cell: LoadCell) -> None:
        """Expect another stream, of this load cell."""
        self._end, self._stream_began = None, now
        self._eyes.restart()
        if load_cell == self._load_cell:
            self._samples.restart()
            return
        self._load_cell = load_cell
        self._samples = SampleWatch(load_cell)
        self._zero = ZeroWatch(
            load_cell.counts_per_kg, load_cell.zero_counts, self._parameters.zero_range, self._began
        )
        self._noise = BeltNoiseWatch(load_cell.sample_rate, self._parameters.max_belt_noise)

    def end_stream(self, *, well: bool, text: str = '') -> None:
        """Note that no more samples are to come, and why."""
        self._end = well, text

    def add(self, now: float, event: SampleBlock | EyeEdge) -> None:
        """Take what has come, after the load cell."""
        if isinstance(event, SampleBlock):
            self._samples.add(now, event)
        else:
            self._samples.clock.add_edge(now, event)
            self._eyes.add(now, event)

    def add_window(self, now: float, window: WeighWindow, segmenter: Segmenter) -> None:
        """Take a window that was cut."""
        self._items.add(now, window.reasons)
        self._edge_check = segmenter.edge_check
        self._zero.add(now, segmenter.zero, item=True)
        if window.reasons or window.t1 is None:
            return
        settle = round(self._parameters.settle_time * window.sample_rate)
        begin = window.empty_begin + (settle if window.empty_begin else 0)
        entry = int((window.t1 - window.stamp) * window.sample_rate / NANOSECONDS)
        self._noise.add(now, window.force[begin : max(entry, begin)])

    def look(self, now: float, segmenter: Segmenter) -> None:
        """Look at the belt where no window comes to show it."""
        self._zero.add(now, segmenter.zero, item=False)
        counts: NDArray[np.int32] = segmenter.idle_belt()
        self._noise.add(now, counts / segmenter.load_cell.counts_per_kg)

    def findings(self, now: float, offset_of_clocks: float) -> list[Finding]:
        """Return all aspects; `offset_of_clocks`: time of day less `now`, s."""
        self._eyes.look(now)
        if self._load_cell is None:
            return [self._without_load_cell(now)]
        self._samples.look(now)
        return [
            self._stream(now),
            self._samples.clock.finding(offset_of_clocks),
            self._eyes.finding(now),
            *([] if self._edge_check is None else [edges_finding(self._edge_check)]),
            self._zero.finding(now),
            self._noise.finding(now),
            self._items.finding(now),
        ]

    def _without_load_cell(self, now: float) -> Finding:
        found = []
        if now - self._began > PATIENCE:
            hint = 'check that the driver runs and publishes it reliable and transient local'
            found.append(Concern(Level.ERROR, 'no load_cell/info has come', hint))
        return conclude('Samples', 'waits for load_cell/info', found)

    def _stream(self, now: float) -> Finding:
        """Return the aspect Samples; a stream that has ended need not go on."""
        finding = self._samples.finding(now, now - self._stream_began)
        if self._end is None:
            return finding
        well, text = self._end
        found = []
        if not well:
            text = f'the source failed: {text}' if text else 'the source failed'
            found.append(Concern(Level.ERROR, text, 'see Source of driver'))
        return conclude('Samples', 'the stream has ended', found, finding.values)
