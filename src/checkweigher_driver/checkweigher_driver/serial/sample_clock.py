# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The time of each sample, from its index and from the times of the reads.

Bus, operating system and scheduler can make a read late, never early. So the true line of time over
index lies below all points (index of the last sample of a read, time of the read). Its estimate is
the line below all points with the smallest mean distance, which is the edge of their lower convex
hull over the middle of the window (Zhang, Liu and Xia, INFOCOM 2002). The points do not show a
delay that every read has, such as the time of a frame on the wire. It is given as `latency`.

Two events break the line. If a read is too early, the clock of the host stepped back or the index
ran ahead, and a new line begins at once. If all reads are late for a while, samples were lost
without notice or the clock of the host stepped forward, and a new line begins with the late reads.
Until then the stamps are in doubt, and `settled` is false.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from checkweigher_core.records import NANOSECONDS

_WINDOW = 60.0  # s of signal for the fit of the line
_BUCKET = 1.0  # s of points, reduced to their hull
_REFIT = 0.25  # s
_WARM_UP = 1.0  # s before the line is trusted, and longest time in doubt after late reads
_WARM_UP_READS = 20
_MAX_DRIFT = 0.02  # relative error of the nominal rate
_KNOWN_DRIFT = 300e-6  # relative change of the rate once it is known
_KNOWN_AFTER = 20.0  # s
_SHIFT = 5_000_000  # ns; one read earlier than this, or all reads later, begin a new line
# Equal to the segmenter's clock_tolerance; beyond it, an item on the belt is a fault, ClockJump.
_STEP = 20_000_000  # ns
_SLEW = 2e-3  # relative rate at which stamps approach the line
_WARM_UP_SLEW = 0.5

_Point = tuple[int, float]  # index; lateness against the nominal rate, ns


@dataclass(slots=True)
class _Line:
    """Line of the lateness against the nominal rate, in ns, over the index."""

    index: int
    offset: float
    slope: float

    def at(self, index: int) -> float:
        return self.offset + self.slope * (index - self.index)


def _lower_hull(points: Sequence[_Point]) -> list[_Point]:
    """Return the lower convex hull of points that are sorted by index."""
    hull: list[_Point] = []
    for x, y in points:
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2:]
            if (y1 - y0) * (x - x0) < (y - y0) * (x1 - x0):
                break
            hull.pop()
        hull.append((x, y))
    return hull


class SampleClock:
    """Stamps of samples from a line that is fitted to the times of their reads.

    The true rate may be off by 2 % from `sample_rate`, Hz; `latency`, s, is the time from a sample
    to the earliest moment at which a read can return it.

    The clock is causal: a stamp depends only on the reads so far. Stamps grow with the index, in
    the order of the calls. Once settled, they approach the line at a rate of at most 0.2 %, except
    at a step beyond 20 ms, which they follow at once. Call `add` before `stamp`, with growing
    indices.
    """

    def __init__(self, sample_rate: float, *, latency: float = 0.0) -> None:
        self._rate = sample_rate
        self._period = NANOSECONDS / sample_rate
        self._latency = round(latency * NANOSECONDS)
        self._slopes = (-_MAX_DRIFT * self._period, _MAX_DRIFT * self._period)
        self._origin = 0, 0  # index and time of the first read
        self._steps = 0
        self._shifts = 0
        self._lateness = (0.0, 0.0)  # mean and maximum of the last bucket, ns
        self._out: _Line | None = None
        self._begin(())

    def _begin(self, points: Sequence[_Point]) -> None:
        self._buckets: deque[list[_Point]] = deque()
        self._bucket: list[_Point] = list(points)
        self._bucket_lateness: list[float] = []  # ns, of the reads of the bucket
        self._fit: _Line | None = None
        self._reads = len(points)
        self._from = points[0][0] if points else 0
        self._next_fit = 0
        self._late: list[_Point] = []
        self._in_doubt = False
        self._end = points[-1][0] if points else -1
        if points:
            self._refit()

    @property
    def settled(self) -> bool:
        """Whether stamps may be used: the line is old enough and not in doubt."""
        return (
            self._fit is not None
            and not self._in_doubt
            and self._reads >= _WARM_UP_READS
            and self._end - self._from >= _WARM_UP * self._rate
        )

    def add(self, first_index: int, count: int, host_ns: int) -> None:
        """Add a read of samples that returned at `host_ns`, on the clock of the stamps."""
        if self._out is None:
            self._origin = first_index, host_ns
        index = first_index - self._origin[0]
        last = index + count - 1
        point = last, host_ns - self._origin[1] - self._period * last
        self._take(point)
        self._follow(index)

    def _take(self, point: _Point) -> None:
        late = 0.0 if self._fit is None else point[1] - self._fit.at(point[0])
        trusted = self._reads >= _WARM_UP_READS
        if late < -_SHIFT and trusted:
            self._restart([point], -late)
            return
        if late > _SHIFT and trusted and self._fit is not None:
            self._late.append(point)
            if self._is_lasting(point):
                self._restart(self._late, min(y - self._fit.at(x) for x, y in self._late))
                return
        else:
            self._late = []
        self._in_doubt = late > _STEP and trusted
        self._extend(point, late)

    def _extend(self, point: _Point, late: float) -> None:
        self._bucket_lateness.append(max(late, 0.0))
        if not self._reads:
            self._from = point[0]
        self._reads += 1
        self._end = point[0]
        self._bucket.append(point)
        if point[0] - self._bucket[0][0] >= _BUCKET * self._rate:
            self._close_bucket()
        if self._fit is None or point[0] >= self._next_fit or late < 0:
            self._refit()

    def _is_lasting(self, point: _Point) -> bool:
        """Return whether reads stay late for longer than after a stall, which ends with a burst."""
        first, enough = self._late[0], _WARM_UP * self._rate
        elapsed = point[0] - first[0] + (point[1] - first[1]) / self._period
        return (
            len(self._late) >= _WARM_UP_READS
            and point[0] - first[0] >= enough
            and elapsed >= enough
        )

    def _restart(self, points: list[_Point], by: float) -> None:
        self._steps += by > _STEP
        self._shifts += by <= _STEP
        if self._fit is not None and self._end - self._from >= _KNOWN_AFTER * self._rate:
            known, spread = self._fit.slope, _KNOWN_DRIFT * self._period
            self._slopes = known - spread, known + spread
        self._begin(points)

    def _close_bucket(self) -> None:
        lateness = self._bucket_lateness
        self._lateness = sum(lateness) / len(lateness), max(lateness)
        self._bucket_lateness = []
        self._buckets.append(_lower_hull(self._bucket))
        self._bucket = []
        oldest = self._end - _WINDOW * self._rate
        while self._buckets[0][-1][0] < oldest:
            self._buckets.popleft()

    def _refit(self) -> None:
        hull = _lower_hull([p for bucket in self._buckets for p in bucket] + self._bucket)
        low, high = self._slopes
        middle = (hull[0][0] + hull[-1][0]) / 2
        slope = self._fit.slope if self._fit is not None else (low + high) / 2
        for (x0, y0), (x1, y1) in pairwise(hull):
            if x0 <= middle <= x1:
                slope = (y1 - y0) / (x1 - x0)
        slope = min(max(slope, low), high)
        offset = min(y - slope * (x - hull[-1][0]) for x, y in hull)
        self._fit = _Line(hull[-1][0], offset, slope)
        self._next_fit = hull[-1][0] + round(_REFIT * self._rate)

    def _follow(self, index: int) -> None:
        """Move the stamps towards the line, beginning with a sample."""
        assert self._fit is not None
        target = self._fit.at(index)
        if self._out is None or abs(target - self._out.at(index)) > _STEP:
            self._out = _Line(index, target, self._fit.slope)
            return
        now = self._out.at(index)
        limit = (_SLEW if self.settled else _WARM_UP_SLEW) * self._period
        pull = (target - now) / (0.1 * self._rate)
        self._out = _Line(index, now, self._fit.slope + min(max(pull, -limit), limit))

    def stamp(self, index: int) -> int:
        """Return the time of a sample, ns; a read must have come before."""
        assert self._out is not None
        x = index - self._origin[0]
        return self._origin[1] - self._latency + round(self._period * x + self._out.at(x))

    def figures(self) -> dict[str, float]:
        """Return the figures for /diagnostics.

        ``clock drift ppm`` is the relative slowness of the device's clock, ``clock offset ms`` the
        distance of the stamps from the line, ``read jitter ms`` and ``latest read ms`` the mean and
        the maximum lateness of a read in the last second.
        """
        drift = offset = 0.0
        if self._fit is not None and self._out is not None:
            drift = self._fit.slope / self._period
            offset = self._fit.at(self._end) - self._out.at(self._end)
        return {
            'clock drift ppm': 1e6 * drift,
            'clock offset ms': 1e-6 * offset,
            'read jitter ms': 1e-6 * self._lateness[0],
            'latest read ms': 1e-6 * self._lateness[1],
            'clock steps': self._steps,
            'clock shifts': self._shifts,
        }
