# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clocks: the stamps of samples and edges against their arrival."""

from collections import deque
import math

from checkweigher_core.health.findings import (
    MINUTE,
    Concern,
    Finding,
    Level,
    RecentValues,
    conclude,
)
from checkweigher_core.records import NANOSECONDS, EyeEdge, SampleBlock

MAX_INBOX = 20_000  # blocks or edges between two looks
RATE_SPAN = 10.0  # s, over which rates are taken
SHORTEST_SPAN = 2.0  # s, below which a rate says nothing
# Stamps that run slower or faster than the machine's clock by more are those of a replay.
_REPLAY = 0.1
_CLOCK_BIN = 5.0  # s; the least delay in each is that of the clock, the others come from the load
_CLOCK_SPAN = 300.0  # s
_DRIFT_LIMIT = 500e-6  # a crystal is right to 100e-6
_DRIFT_BINS = 6  # least number for a drift
_PACE_BINS = 3
_JITTER_LIMIT = 0.5  # s; less shows in the margin of the verdicts where it matters
_START = 5.0  # s, in which nodes that start keep each other waiting
_EYE_OFFSET_LIMIT = 0.1  # s
_FEWEST_EDGES = 4
_CLOCK_STEP = 0.5  # s, by which stamp and index may disagree before it is another clock


class ClockWatch:
    """Compare the stamps of samples and edges with their arrival.

    The delay of a block is its arrival less the time at which its last sample was taken. The least
    delay of a few seconds is that of a message that did not wait, so it moves as the clocks do.
    """

    def __init__(self, sample_rate: float) -> None:
        self._rate = sample_rate
        self.restart()

    def restart(self) -> None:
        """Forget the clock of the stream before."""
        self._origin: int | None = None
        self._began = 0.0
        self._blocks: deque[tuple[float, int, int]] = deque(maxlen=MAX_INBOX)
        self._edges: deque[tuple[float, int]] = deque(maxlen=MAX_INBOX)
        self._delays = RecentValues(RATE_SPAN)
        self._edge_delays = RecentValues(MINUTE)
        self._bins = RecentValues(_CLOCK_SPAN)
        self._bin: tuple[float, float] | None = None  # its begin and its least delay

    def add(self, came: float, block: SampleBlock) -> None:
        """Take a block, in the order of their indices."""
        if self._blocks:
            _, stamp, index = self._blocks[-1]
            expected = stamp + (block.first_index - index) * NANOSECONDS / self._rate
            if abs(block.stamp - expected) > _CLOCK_STEP * NANOSECONDS:
                self.restart()
        if self._origin is None:
            self._origin, self._began = block.stamp, came
        self._blocks.append((came, block.stamp, block.first_index))
        delay = came - (block.stamp - self._origin) / NANOSECONDS - len(block.counts) / self._rate
        if came - self._began > _START:
            self._delays.add(came, delay)
        if self._bin is None:
            self._bin = came, delay
        begin, least = self._bin
        if came - begin >= _CLOCK_BIN:
            self._bins.add(begin + _CLOCK_BIN / 2, least)
            self._bin = came, delay
        else:
            self._bin = begin, min(least, delay)

    def add_edge(self, came: float, edge: EyeEdge) -> None:
        """Take an edge of a photo-eye, from any thread."""
        self._edges.append((came, edge.stamp))

    def look(self, now: float) -> None:
        """Work through the edges and forget what is old."""
        edges = [self._edges.popleft() for _ in range(len(self._edges))]
        if self._origin is not None:
            for came, stamp in edges:
                self._edge_delays.add(came, came - (stamp - self._origin) / NANOSECONDS)
        for values in (self._delays, self._bins, self._edge_delays):
            values.forget(now)
        while self._blocks and self._blocks[0][0] <= now - RATE_SPAN:
            self._blocks.popleft()

    def _pace(self, slope: float) -> float:
        """Return seconds of the stamps in a second; NaN if not known.

        From the least delays once there are some: after a halt blocks come faster for a while.
        """
        if len(self._bins) >= _PACE_BINS:
            return 1.0 - slope
        if len(self._blocks) < 2:
            return math.nan
        (began, first_stamp, _), (came, last_stamp, _) = self._blocks[0], self._blocks[-1]
        elapsed = came - began
        if elapsed < SHORTEST_SPAN:
            return math.nan
        return (last_stamp - first_stamp) / NANOSECONDS / elapsed

    @property
    def sample_rate(self) -> float:
        """Hz of the index in the time of the stamps, lately; NaN if not known."""
        if len(self._blocks) < 2:
            return math.nan
        (_, first_stamp, first), (_, last_stamp, last) = self._blocks[0], self._blocks[-1]
        elapsed = (last_stamp - first_stamp) / NANOSECONDS
        return (last - first) / elapsed if elapsed >= SHORTEST_SPAN else math.nan

    def _least(self) -> float:
        """Return the least delay of a block lately, s from the stamp of the first one."""
        bins = self._bins.values[-round(MINUTE / _CLOCK_BIN) :].tolist()
        last = [] if self._bin is None else [self._bin[1]]
        return float(min([*bins, *last], default=math.nan))

    def finding(self, offset_of_clocks: float) -> Finding:
        """Return the aspect Clock; `offset_of_clocks`: time of day less that of arrivals, s."""
        least, slope = self._least(), self._bins.slope
        offset = math.nan
        if self._origin is not None:
            offset = least + offset_of_clocks - self._origin / NANOSECONDS
        pace = self._pace(slope)
        # By how much 95 % of the blocks are not later than the least late one, s.
        jitter = self._delays.quantile(0.95) - self._delays.smallest
        eye_offset = math.nan  # how much later the edges come than the samples of the same time, s
        if len(self._edge_delays) >= _FEWEST_EDGES:
            eye_offset = self._edge_delays.smallest - least
        # How much faster the machine's clock runs than that of the stamps, relative.
        drift = slope if len(self._bins) >= _DRIFT_BINS else math.nan
        values = {
            'stamps_behind_this_machine_s': offset,
            'drift_ppm': 1e6 * drift,
            'jitter_of_arrival_ms': 1e3 * jitter,
            'edges_behind_samples_ms': 1e3 * eye_offset,
            'pace_of_stamps': pace,
        }
        if math.isnan(pace):
            return conclude('Clock', 'not known yet', (), values)
        if abs(pace - 1) > _REPLAY:
            text = f'the stamps run at {pace:.2f} times real time, as those of a replay do'
            return conclude('Clock', text, (), values)
        concerns = _concerns(drift, jitter, eye_offset)
        return conclude('Clock', 'stamps and arrival agree', concerns, values)


def _concerns(drift: float, jitter: float, eye_offset: float) -> list[Concern]:
    found = []
    if abs(eye_offset) > _EYE_OFFSET_LIMIT:
        side = 'later' if eye_offset > 0 else 'earlier'
        text = f'edges come {abs(eye_offset):.2f} s {side} than samples of the same stamp'
        hint = 'check that load cell and photo-eyes are stamped by one clock'
        found.append(Concern(Level.WARN, text, hint))
    if abs(drift) > _DRIFT_LIMIT:
        text = f'the stamps drift by {1e6 * drift:.0f} ppm against this machine'
        hint = 'check the sample rate in load_cell/info and what the stamps are made of'
        found.append(Concern(Level.WARN, text, hint))
    if jitter > _JITTER_LIMIT:
        text = f'blocks come up to {1e3 * jitter:.0f} ms late'
        hint = 'check the load on this machine and the network to the driver'
        found.append(Concern(Level.WARN, text, hint))
    return found
