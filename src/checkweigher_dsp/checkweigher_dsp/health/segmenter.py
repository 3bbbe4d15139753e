# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Findings of the segmenter: samples, clock, photo-eyes, zero, noise and items."""

import math

from checkweigher_core.health.findings import Concern, Finding, Level, conclude, error_if, warn_if
from checkweigher_core.health.stream import PATIENCE, EyeWatch, SampleWatch
from checkweigher_core.records import NANOSECONDS, EyeEdge, LoadCell, SampleBlock, WeighWindow
from checkweigher_dsp.health.items import FaultWatch
from checkweigher_dsp.health.scale import BeltNoiseWatch, ZeroWatch
from checkweigher_dsp.segmentation.edge_check import EdgeCheck
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

_MILLI = 1e3
# Change of the lag of the load behind the photo-eye edges, in ms, above which an error is given.
# Differences between products change the lag by up to 0.5 ms.
_CHANGED = 1.5
# Difference in ms between the lag of the load and the stated lag, above which a warning or an error
# is given.
_LARGE = 2.0
_MANY_UNCHECKED = 0.5  # fraction of unchecked items above which a warning is given.
# Minimum number of checked items for an error on a large lag. The fraction of unchecked items is
# relative to at least this number of items.
_FEWEST = 10


class SegmenterWatch:
    """Statistics of a segmenter whose node was started at the time `began` in s."""

    def __init__(self, parameters: SegmenterParameters, began: float) -> None:
        self._parameters = parameters
        self._began = began
        self._load_cell: LoadCell | None = None
        # `begin_stream` sets `_samples`, `_zero` and `_noise`, which depend on the load cell.
        self._samples: SampleWatch
        self._zero: ZeroWatch
        self._noise: BeltNoiseWatch
        self._eyes = EyeWatch()
        self._edge_check: EdgeCheck | None = None
        self._items = FaultWatch()
        # Whether the last stream succeeded, and the message of the source; None during a stream.
        self._end: tuple[bool, str] | None = None
        self._stream_began = began

    def begin_stream(self, now: float, load_cell: LoadCell) -> None:
        """Begin a new stream. Reset the statistics of samples and scale if the load cell is new."""
        self._end, self._stream_began = None, now
        self._eyes.restart()
        if load_cell == self._load_cell:
            self._samples.restart()
            return
        self._load_cell = load_cell
        self._samples = SampleWatch(load_cell)
        self._zero = ZeroWatch(
            load_cell.counts_per_kg,
            load_cell.zero_counts,
            self._parameters.zero_range,
            self._began,
            self._parameters.zero_drift or math.inf,
        )
        self._noise = BeltNoiseWatch(load_cell.sample_rate, self._parameters.max_belt_noise)

    def set_zero(self) -> None:
        """Register that a person has set the zero."""
        self._zero.set()

    def end_stream(self, *, well: bool, text: str = '') -> None:
        """End the stream.

        `well` is true if the stream succeeded, and `text` is the message of the source.
        """
        self._end = well, text

    def add(self, now: float, event: SampleBlock | EyeEdge) -> None:
        """Add a block of samples or an edge of the stream.

        The caller must have called `begin_stream`.
        """
        if isinstance(event, SampleBlock):
            self._samples.add(now, event)
        else:
            self._samples.clock.add_edge(now, event)
            self._eyes.add(now, event)

    def add_window(self, now: float, window: WeighWindow, segmenter: Segmenter) -> None:
        """Add a window, with the zero and the edge check of `segmenter`.

        The samples of the empty belt before the item are added to the statistics of the noise,
        unless the window is a fault or t1 is unknown.
        """
        self._items.add(now, window.reasons)
        self._edge_check = segmenter.cutter.edge_check
        self._zero.add(now, segmenter.zero_keeper.zero, item=True)
        if window.reasons or window.t1 is None:
            return
        settle = round(self._parameters.settle_time * window.sample_rate)
        begin = window.empty_begin + (settle if window.empty_begin else 0)
        entry = int((window.t1 - window.stamp) * window.sample_rate / NANOSECONDS)
        self._noise.add(now, window.force[begin : max(entry, begin)])

    def look(self, now: float, segmenter: Segmenter) -> None:
        """Add the zero and the noise of an idle belt, because an idle belt produces no windows."""
        self._zero.add(now, segmenter.zero_keeper.zero, item=False)
        self._noise.add(now, segmenter.idle_belt() / segmenter.load_cell.counts_per_kg)

    def findings(self, now: float, offset_of_clocks: float) -> list[Finding]:
        """Return all findings. `offset_of_clocks` is the time of day in s minus `now`.

        Before the first load cell is known, the only finding is on the aspect Samples.
        """
        self._eyes.look(now)
        if self._load_cell is None:
            missing = error_if(
                now - self._began > PATIENCE,
                'no load_cell/info has arrived',
                'check that the driver runs and publishes it with QoS reliable, transient local',
            )
            return [conclude('Samples', 'waits for load_cell/info', [missing])]
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

    def _stream(self, now: float) -> Finding:
        """Return the finding on the stream of samples (aspect Samples).

        No samples are expected after a stream ends.
        """
        finding = self._samples.finding(now, now - self._stream_began)
        if self._end is None:
            return finding
        well, text = self._end
        failed = f'the source failed: {text}' if text else 'the source failed'
        concerns = [error_if(not well, failed, 'see Source of driver')]
        return conclude('Samples', 'the stream has ended', concerns, finding.values)


def edges_finding(check: EdgeCheck) -> Finding:
    """Return the finding on the lag of the load (aspect Eyes and samples)."""
    lag, change, reference = (_MILLI * value for value in (check.lag, check.change, check.learned))
    values = {
        'lag_beyond_stated_ms': lag,
        'learned_lag_beyond_stated_ms': reference,
        'change_ms': change,
        'items_checked': check.checked,
        'items_unchecked': check.unchecked,
    }
    side = 'later' if change > 0 else 'earlier'
    # A lag that is too large to be learned is an error, because it makes each item a fault.
    too_large = math.isnan(check.learned) and check.checked >= _FEWEST
    beyond = lag if too_large else reference
    is_large = not check.is_stated and abs(beyond) > _LARGE
    unstated = Concern(
        Level.ERROR if too_large else Level.WARN,
        f'the load lags {beyond:.1f} ms more behind the eyes than rise_lag states',
        'measure it by calibrate --dynamic, or set rise_lag to the delay of the amplifier',
    )
    concerns = [
        error_if(
            abs(change) > _CHANGED,
            f'relative to the eyes, the load rises {abs(change):.1f} ms {side} than before',
            'check the filter of the amplifier, the clocks, and the place and delay of the eyes',
        ),
        unstated if is_large else None,
        warn_if(
            check.unchecked > _MANY_UNCHECKED * max(check.checked + check.unchecked, _FEWEST),
            'the rise of the load is not visible for most items, so that the eyes are not checked',
            'leave at least 0.06 s of empty belt before each item',
        ),
    ]
    well = 'no item yet' if math.isnan(lag) else f'lag of the load {lag:+.1f} ms from rise_lag'
    return conclude('Eyes and samples', well, concerns, values)
