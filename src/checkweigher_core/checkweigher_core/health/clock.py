# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Comparison of the stamps of samples and edges with their times of arrival."""

from collections import deque
import math

from checkweigher_core.health.findings import MINUTE, Finding, RecentValues, conclude, warn_if
from checkweigher_core.records import NANOSECONDS, EyeEdge, SampleBlock

_MAX_BLOCKS = 20_000  # largest number of blocks from which sample rate and pace are computed
RATE_SPAN = 10.0  # duration in s of the latest signal from which rates are computed
SHORTEST_SPAN = 2.0  # shortest duration in s of the signal from which a rate is computed
_REPLAY = 0.1  # difference of the pace from 1 above which a replay is assumed
_CLOCK_BIN = 5.0  # duration of a bin in s; at least one block of each bin is assumed to be on time
_CLOCK_SPAN = 300.0  # time in s over which the drift is computed
_DRIFT_LIMIT = 500e-6  # largest relative drift without a warning; a crystal has less than 100e-6
_DRIFT_BINS = 6  # smallest number of bins from which a drift is computed
_PACE_BINS = 3  # smallest number of bins from which the pace is computed
_JITTER_LIMIT = 0.5  # largest jitter in s without a warning
_START = 5.0  # time in s after the first block during which jitter is ignored
_EYE_OFFSET_LIMIT = 0.1  # largest delay in s of edges relative to samples without a warning
_FEWEST_EDGES = 4  # smallest number of edges from which their delay is computed
_CLOCK_STEP = 0.5  # error of a predicted stamp in s above which a step of the clock is assumed


class ClockWatch:
    """Comparison of the stamps of samples and edges with their times of arrival.

    The delay of a block is the time from its last sample to its arrival. The delay is known only up
    to a constant, because the stamps and the arrivals may be on different clocks. Within a few
    seconds, at least one block arrives without waiting, so the shortest delay changes only if a
    clock drifts. The pace is the rate at which the stamps advance, relative to the clock of this
    machine.
    """

    def __init__(self, sample_rate: float) -> None:
        self._rate = sample_rate
        self.restart()

    def restart(self) -> None:
        """Discard all values, because a new stream begins or the clock of the stamps was set."""
        self._origin: int | None = None
        self._began = 0.0
        self._blocks: deque[tuple[float, int, int]] = deque(maxlen=_MAX_BLOCKS)
        self._delays = RecentValues(RATE_SPAN)
        self._edge_delays = RecentValues(MINUTE)
        self._bins = RecentValues(_CLOCK_SPAN)
        self._bin = (math.nan, math.inf)  # start and shortest delay in s of the present bin

    def add(self, came: float, block: SampleBlock) -> None:
        """Add a block that arrived at time `came` in s.

        If the stamp of the block differs by more than 0.5 s from the stamp expected from its index,
        the clock of the stamps was set, and all earlier values are discarded.
        """
        if self._blocks:
            _, stamp, index = self._blocks[-1]
            expected = stamp + (block.first_index - index) * NANOSECONDS / self._rate
            if abs(block.stamp - expected) > _CLOCK_STEP * NANOSECONDS:
                self.restart()
        if self._origin is None:
            self._origin, self._began = block.stamp, came
            self._bin = came, math.inf
        self._blocks.append((came, block.stamp, block.first_index))
        delay = came - (block.stamp - self._origin) / NANOSECONDS - len(block.counts) / self._rate
        if came - self._began > _START:
            self._delays.add(came, delay)
        begin, least = self._bin
        if came - begin >= _CLOCK_BIN:
            self._bins.add(begin + _CLOCK_BIN / 2, least)
            self._bin = came, delay
        else:
            self._bin = begin, min(least, delay)

    def add_edge(self, came: float, edge: EyeEdge) -> None:
        """Add an edge that arrived at time `came` in s, unless no block has arrived yet."""
        if self._origin is not None:
            self._edge_delays.add(came, came - (edge.stamp - self._origin) / NANOSECONDS)

    def look(self, now: float) -> None:
        """Remove values that are too old at time `now` in s.

        Blocks and their delays are kept for 10 s, edges for 60 s, and bins for 300 s.
        """
        for values in (self._delays, self._bins, self._edge_delays):
            values.forget(now)
        while self._blocks and self._blocks[0][0] <= now - RATE_SPAN:
            self._blocks.popleft()

    def _pace(self, slope: float) -> float:
        """Return the pace of the stamps, NaN with fewer than 3 bins and less than 2 s of blocks.

        The pace is computed from `slope`, the trend of the shortest delays, as soon as three bins
        are complete. Until then, the pace is computed from the stamps and the arrivals of the
        oldest and the latest recent block. The pace from two blocks is less accurate, because
        blocks arrive too fast for a while after a halt.
        """
        if len(self._bins) >= _PACE_BINS:
            return 1.0 - slope
        arrival, elapsed, _ = self._span()
        return elapsed / arrival if arrival >= SHORTEST_SPAN else math.nan

    @property
    def sample_rate(self) -> float:
        """Sample rate in Hz by the stamps of the last 10 s, NaN if they span less than 2 s."""
        _, elapsed, count = self._span()
        return count / elapsed if elapsed >= SHORTEST_SPAN else math.nan

    def _span(self) -> tuple[float, float, int]:
        """Return the span of the recent blocks: by arrival in s, by stamp in s, and in samples."""
        if not self._blocks:
            return 0.0, 0.0, 0
        (began, first_stamp, first), (came, last_stamp, last) = self._blocks[0], self._blocks[-1]
        return came - began, (last_stamp - first_stamp) / NANOSECONDS, last - first

    def finding(self, offset_of_clocks: float) -> Finding:
        """Return the finding "Clock" of the diagnostics.

        `offset_of_clocks` is the Unix time minus the time on the clock of the arrivals, in s.
        """
        # Shortest delay in s of the blocks of the last minute, with stamps relative to the first
        # stamp.
        least = min([*self._bins.values[-round(MINUTE / _CLOCK_BIN) :].tolist(), self._bin[1]])
        least = math.nan if math.isinf(least) else least
        slope = self._bins.slope
        origin = math.nan if self._origin is None else self._origin / NANOSECONDS
        pace = self._pace(slope)
        # Jitter in s: 95 % of the delays exceed the shortest delay by at most this time.
        jitter = self._delays.quantile(0.95) - self._delays.smallest
        # Delay of the edges in s, relative to samples with the same stamp.
        is_known = len(self._edge_delays) >= _FEWEST_EDGES
        eye_offset = self._edge_delays.smallest - least if is_known else math.nan
        # Relative difference between the rates of the clock of the arrivals and the clock of the
        # stamps.
        drift = slope if len(self._bins) >= _DRIFT_BINS else math.nan
        values = {
            'stamps_behind_this_machine_s': least + offset_of_clocks - origin,
            'drift_ppm': 1e6 * drift,
            'jitter_of_arrival_ms': 1e3 * jitter,
            'edges_behind_samples_ms': 1e3 * eye_offset,
            'pace_of_stamps': pace,
        }
        if math.isnan(pace):
            return conclude('Clock', 'not known yet', values=values)
        if abs(pace - 1) > _REPLAY:
            text = f'the stamps advance at {pace:.2f} times real time, as in a replay'
            return conclude('Clock', text, values=values)
        side = 'later' if eye_offset > 0 else 'earlier'
        concerns = [
            warn_if(
                abs(eye_offset) > _EYE_OFFSET_LIMIT,
                f'edges arrive {abs(eye_offset):.2f} s {side} than samples with the same stamp',
                'check that one clock stamps the load cell and the photo-eyes',
            ),
            warn_if(
                abs(drift) > _DRIFT_LIMIT,
                f'the stamps drift by {1e6 * drift:.0f} ppm relative to this machine',
                'check the sample rate in load_cell/info and the clock of the stamps',
            ),
            warn_if(
                jitter > _JITTER_LIMIT,
                f'5 % of the blocks are at least {1e3 * jitter:.0f} ms late',
                'check the load on this machine and the network to the driver',
            ),
        ]
        return conclude('Clock', 'stamps and arrival times agree', concerns, values)
