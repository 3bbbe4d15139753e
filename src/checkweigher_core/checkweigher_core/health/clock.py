# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clocks: comparison of the stamps of samples and edges with their arrival."""

from collections import deque
import math

from checkweigher_core.health.findings import MINUTE, Finding, RecentValues, conclude, warn_if
from checkweigher_core.records import NANOSECONDS, EyeEdge, SampleBlock

_MAX_BLOCKS = 20_000  # from which rate and pace are computed
RATE_SPAN = 10.0  # s over which rates are computed
SHORTEST_SPAN = 2.0  # s; over a shorter span, a rate is unknown
_REPLAY = 0.1  # relative difference of pace; a larger one means a replay
_CLOCK_BIN = 5.0  # s; the shortest delay in each shows the clock, longer ones are due to load
_CLOCK_SPAN = 300.0  # s
_DRIFT_LIMIT = 500e-6  # relative; a crystal is off by less than 100e-6
_DRIFT_BINS = 6  # fewest bins from which a drift is computed
_PACE_BINS = 3
_JITTER_LIMIT = 0.5  # s; the margin of the verdicts shows whether less matters
_START = 5.0  # s after the first block; the start of other nodes then causes delays
_EYE_OFFSET_LIMIT = 0.1  # s
_FEWEST_EDGES = 4
_CLOCK_STEP = 0.5  # s, largest difference between stamp and index of one clock


class ClockWatch:
    """Comparison of the stamps of samples and edges with their arrival.

    The delay of a block is its arrival minus the time of its last sample. The shortest delay in a
    few seconds belongs to a message that did not wait, so it changes only with the clocks.
    """

    def __init__(self, sample_rate: float) -> None:
        self._rate = sample_rate
        self.restart()

    def restart(self) -> None:
        """Discard the clock of the previous stream."""
        self._origin: int | None = None
        self._began = 0.0
        self._blocks: deque[tuple[float, int, int]] = deque(maxlen=_MAX_BLOCKS)
        self._delays = RecentValues(RATE_SPAN)
        self._edge_delays = RecentValues(MINUTE)
        self._bins = RecentValues(_CLOCK_SPAN)
        self._bin = (math.nan, math.inf)  # begin and least delay

    def add(self, came: float, block: SampleBlock) -> None:
        """Add a block, in the order of the indices."""
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
        """Add an edge of a photo-eye; edges before the first block have no delay."""
        if self._origin is not None:
            self._edge_delays.add(came, came - (edge.stamp - self._origin) / NANOSECONDS)

    def look(self, now: float) -> None:
        """Remove old values."""
        for values in (self._delays, self._bins, self._edge_delays):
            values.forget(now)
        while self._blocks and self._blocks[0][0] <= now - RATE_SPAN:
            self._blocks.popleft()

    def _pace(self, slope: float) -> float:
        """Return the seconds of stamps per second of this machine, NaN if unknown.

        It is computed from the shortest delays once these are known, because blocks come faster for
        a while after a halt.
        """
        if len(self._bins) >= _PACE_BINS:
            return 1.0 - slope
        arrival, elapsed, _ = self._span()
        return elapsed / arrival if arrival >= SHORTEST_SPAN else math.nan

    @property
    def sample_rate(self) -> float:
        """Sample rate by the stamps in the last seconds, Hz; NaN if unknown."""
        _, elapsed, count = self._span()
        return count / elapsed if elapsed >= SHORTEST_SPAN else math.nan

    def _span(self) -> tuple[float, float, int]:
        """Return the span of the last blocks: in s by arrival, in s by stamp, and in samples."""
        if not self._blocks:
            return 0.0, 0.0, 0
        (began, first_stamp, first), (came, last_stamp, last) = self._blocks[0], self._blocks[-1]
        return came - began, (last_stamp - first_stamp) / NANOSECONDS, last - first

    def _least(self) -> float:
        """Return the shortest recent delay of a block, s, relative to the first stamp."""
        least = min([*self._bins.values[-round(MINUTE / _CLOCK_BIN) :].tolist(), self._bin[1]])
        return math.nan if math.isinf(least) else float(least)

    def finding(self, offset_of_clocks: float) -> Finding:
        """Return the aspect Clock; `offset_of_clocks` is the time of day at arrival time 0, s."""
        least, slope = self._least(), self._bins.slope
        origin = math.nan if self._origin is None else self._origin / NANOSECONDS
        pace = self._pace(slope)
        # Delay that 95 % of the blocks do not exceed, relative to the shortest one, s.
        jitter = self._delays.quantile(0.95) - self._delays.smallest
        # Delay of the edges relative to samples of the same time, s.
        is_known = len(self._edge_delays) >= _FEWEST_EDGES
        eye_offset = self._edge_delays.smallest - least if is_known else math.nan
        # Relative difference between the clocks of the machine and of the stamps.
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
            text = f'the stamps run at {pace:.2f} times real time, as those of a replay do'
            return conclude('Clock', text, values=values)
        side = 'later' if eye_offset > 0 else 'earlier'
        concerns = [
            warn_if(
                abs(eye_offset) > _EYE_OFFSET_LIMIT,
                f'edges come {abs(eye_offset):.2f} s {side} than samples of the same stamp',
                'check that load cell and photo-eyes are stamped by one clock',
            ),
            warn_if(
                abs(drift) > _DRIFT_LIMIT,
                f'the stamps drift by {1e6 * drift:.0f} ppm against this machine',
                'check the sample rate in load_cell/info and what the stamps are made of',
            ),
            warn_if(
                jitter > _JITTER_LIMIT,
                f'blocks come up to {1e3 * jitter:.0f} ms late',
                'check the load on this machine and the network to the driver',
            ),
        ]
        return conclude('Clock', 'stamps and arrival agree', concerns, values)
