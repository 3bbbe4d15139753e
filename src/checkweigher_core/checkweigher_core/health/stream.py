# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Statistics of arriving samples and photo-eye edges, such as rate, gaps and saturation."""

import math

import numpy as np

from checkweigher_core.health.clock import RATE_SPAN, SHORTEST_SPAN, ClockWatch
from checkweigher_core.health.findings import (
    MINUTE,
    Concern,
    Finding,
    RecentValues,
    conclude,
    error_if,
    warn_if,
)
from checkweigher_core.printable import counted
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, SampleBlock

PATIENCE = 5.0  # longest time in s that the nodes of a line need to start
_SILENCE = 1.0  # longest time in s without samples before an error (or `_SILENT_BLOCKS`, if longer)
_SILENT_BLOCKS = 5.0  # longest time without samples before an error, in durations of a block
_RATE_TOLERANCE = 0.005  # largest relative error of the nominal sample rate without a warning
_LONGEST_BLOCKED = 10.0  # longest time in s for which a product normally blocks an eye
_ONE_EYED = 10  # smallest number of edges of one eye in a minute for a comparison of both eyes
_OTHER = {Eye.INFEED: Eye.OUTFEED, Eye.OUTFEED: Eye.INFEED}
# Ratio of the numbers of edges of the two eyes above which an eye may be dirty.
_MANY_MORE = 1.5
# An edge of an eye is quick if it follows the previous one sooner than this fraction of the lower
# quartile of the intervals at the other eye. A dirty eye causes several quick edges in a row. A
# product causes at most one, even if it is short and the other eye has missed it.
_QUICK = 0.5
# Smallest ratio of the quick edges that follow another one to the surplus edges of a dirty eye.
_IN_A_ROW = 0.3
_GAPS, _LOST, _AGAIN = 'gaps', 'samples_lost', 'blocks_doubled_or_late'
_RESTARTS, _SATURATED = 'source_restarts', 'samples_saturated'
# Names of the counts, each with the noun that follows its number in messages.
_COUNTED = {_GAPS: 'gap', _LOST: 'sample', _AGAIN: 'block', _RESTARTS: 'time', _SATURATED: 'sample'}
_WARNINGS = {
    _GAPS: ('{samples_lost} lost in {gaps}', 'check processor load, cable and network'),
    _AGAIN: (
        '{blocks_doubled_or_late} arrived twice or too late',
        'check whether two drivers run, and the network between driver and segmenter',
    ),
    _RESTARTS: (
        'the source restarted {source_restarts}',
        'check the power of the load cell, and whether two drivers run',
    ),
    _SATURATED: (
        '{samples_saturated} at the limit of the converter',
        'check for overload, and check the load-cell wiring',
    ),
}


class SampleWatch:
    """Statistics of arriving blocks of samples: their rate, gaps, saturation and clock."""

    def __init__(self, load_cell: LoadCell) -> None:
        self.load_cell = load_cell
        self.clock = ClockWatch(load_cell.sample_rate)
        self._last = -math.inf
        self._end: int | None = None
        self._last_stamp = 0
        self._block = 0.0  # duration of the latest block in s
        self._arrivals = RecentValues(RATE_SPAN)
        self._counts = dict.fromkeys(_COUNTED, 0)
        self._recent = {what: RecentValues() for what in _COUNTED}

    def restart(self) -> None:
        """Discard the expected index and the values of `clock`, because a new stream begins.

        All rates and counts are kept, except the sample rate that `clock` computes from the stamps.
        """
        self._end = None
        self.clock.restart()

    def look(self, now: float) -> None:
        """Remove values that are too old at time `now` in s.

        Arrivals are kept for 10 s, and events such as gaps for 60 s.
        """
        for values in (self._arrivals, *self._recent.values()):
            values.forget(now)
        self.clock.look(now)

    def add(self, came: float, block: SampleBlock) -> None:
        """Add a block that arrived at time `came` in s. An empty block is ignored."""
        size, first, limits = len(block.counts), block.first_index, self.load_cell
        if not size:
            return
        bad = (block.counts <= limits.min_counts) | (block.counts >= limits.max_counts)
        self._note(_SATURATED, came, int(np.count_nonzero(bad)))
        self._last = came
        self._arrivals.add(came, size)
        self._block = size / limits.sample_rate
        if self._end is not None and first != self._end:
            if first > self._end:
                self._note(_GAPS, came, 1)
                self._note(_LOST, came, first - self._end)
            elif block.stamp <= self._last_stamp:
                self._note(_AGAIN, came, 1)
                return
            else:
                self._note(_RESTARTS, came, 1)
                self.clock.restart()
        self._end, self._last_stamp = first + size, block.stamp
        self.clock.add(came, block)

    def _note(self, what: str, time: float, count: int) -> None:
        if count:
            self._counts[what] += count
            self._recent[what].add(time, count)

    def finding(self, now: float, waited: float) -> Finding:
        """Return the finding "Samples" at time `now` in s.

        `waited` is the time in s since the stream began.
        """
        age = now - self._last
        lately = {name: int(values.total) for name, values in self._recent.items()}
        span = self._arrivals.span if self._arrivals.span >= SHORTEST_SPAN else math.nan
        values = {
            'sample_rate_nominal_hz': self.load_cell.sample_rate,
            'sample_rate_by_stamps_hz': self.clock.sample_rate,
            'received_samples_per_s': self._arrivals.values[1:].sum() / span,
            'received_blocks_per_s': (len(self._arrivals) - 1) / span,
            'age_of_last_block_s': age,
            **self._counts,
        }
        concerns = self._concerns(age, waited, lately)
        return conclude('Samples', f'{self.load_cell.sample_rate:g} samples/s', concerns, values)

    def _concerns(self, age: float, waited: float, lately: dict[str, int]) -> list[Concern | None]:
        numbers = {what: counted(lately[what], name) for what, name in _COUNTED.items()}
        rate, nominal = self.clock.sample_rate, self.load_cell.sample_rate
        return [
            error_if(
                age > max(_SILENCE, _SILENT_BLOCKS * self._block) and waited > PATIENCE,
                'no samples have arrived' if age == math.inf else f'no samples for {age:.1f} s',
                'check that the driver runs, and the cable and power of the load cell',
            ),
            *(
                warn_if(lately[what] > 0, f'{text.format(**numbers)} in the last minute', hint)
                for what, (text, hint) in _WARNINGS.items()
            ),
            warn_if(
                abs(rate - nominal) > _RATE_TOLERANCE * nominal,
                f'{rate:.1f} samples/s by their stamps, but {nominal:g} in load_cell/info',
                'compare the sample rate of the load cell with load_cell/info',
            ),
        ]


class EyeWatch:
    """Statistics of photo-eye edges, which show whether an eye is blocked, idle or dirty."""

    def __init__(self) -> None:
        self._counts = dict.fromkeys(Eye, 0)
        self._last = math.nan
        self.restart()

    def add(self, now: float, edge: EyeEdge) -> None:
        """Add an edge that arrived at time `now` in s."""
        eye = Eye(edge.eye)
        self._last = now
        self._counts[eye] += 1
        since = (edge.stamp - self._stamps.get(eye, 0)) / NANOSECONDS
        self._stamps[eye] = edge.stamp
        self._recent[eye].add(now, since)
        if edge.blocked:
            self._blocked.setdefault(eye, now)
        else:
            self._blocked.pop(eye, None)

    def restart(self) -> None:
        """Discard the states and the recent edges of the eyes, because a new stream begins.

        The total numbers of edges are kept.
        """
        # Intervals in s between the edges of each eye, and the stamp of its latest edge in ns. The
        # interval before the first edge counts from the stamp 0.
        self._recent = {eye: RecentValues() for eye in Eye}
        self._stamps: dict[Eye, int] = {}
        self._blocked: dict[Eye, float] = {}

    def look(self, now: float) -> None:
        """Remove edges that are more than 60 s old at time `now` in s."""
        for values in self._recent.values():
            values.forget(now)

    def finding(self, now: float) -> Finding:
        """Return the finding "Photo eyes" at time `now` in s."""
        lately = {eye: len(values) for eye, values in self._recent.items()}
        blocked = {eye: now - since for eye, since in self._blocked.items()}
        values = {
            'edges_per_s': sum(lately.values()) / MINUTE,
            'age_of_last_edge_s': now - self._last,
            'infeed_edges': self._counts[Eye.INFEED],
            'outfeed_edges': self._counts[Eye.OUTFEED],
            'infeed_blocked_for_s': blocked.get(Eye.INFEED, 0.0),
            'outfeed_blocked_for_s': blocked.get(Eye.OUTFEED, 0.0),
        }
        concerns = [
            warn_if(
                duration > _LONGEST_BLOCKED,
                f'the {eye.name.lower()} eye has been blocked for {duration:.0f} s',
                'check for a jammed product, dirt, and the alignment of the eye',
            )
            for eye, duration in blocked.items()
        ]
        concerns += [
            error_if(
                lately[eye] == 0 and lately[other] >= _ONE_EYED,
                f'only the {other.name.lower()} eye has switched in the last minute',
                f'check the {eye.name.lower()} eye, its wiring and its alignment',
            )
            for eye, other in _OTHER.items()
        ]
        concerns += [
            warn_if(
                self._is_dirty(eye, other),
                f'the {eye.name.lower()} eye has switched {lately[eye]} times in the last minute, '
                f'but the {other.name.lower()} eye {lately[other]} times',
                f'clean the {eye.name.lower()} eye and check its alignment: a dirty eye switches '
                'several times at a product',
            )
            for eye, other in _OTHER.items()
        ]
        if any(lately.values()):
            well = 'both switch' if all(lately.values()) else 'few products in the last minute'
        else:
            well = 'no product in the last minute'
        return conclude('Photo eyes', well, concerns, values)

    def _is_dirty(self, eye: Eye, other: Eye) -> bool:
        """Return whether an eye has many more edges than the other one, and quick ones in a row."""
        own, others = self._recent[eye], self._recent[other]
        if len(others) < _ONE_EYED or len(own) <= _MANY_MORE * len(others):
            return False
        quick = own.values < _QUICK * others.quantile(0.25)
        in_a_row = np.count_nonzero(quick[1:] & quick[:-1])
        return bool(in_a_row >= _IN_A_ROW * (len(own) - len(others)))
