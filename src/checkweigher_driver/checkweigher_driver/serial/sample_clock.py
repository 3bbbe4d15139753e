# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimation of the time of each sample from its index and from the times of the reads.

Bus, operating system and scheduler can make a read late, but never early. Each read is a point: the
index of its last sample, and its time. The line of the true time over the index therefore lies
below all points. The estimate is the line below all points that has the smallest mean distance from
the points. The estimated line is an edge of the lower convex hull of the points, namely the edge at
the middle of the window (Zhang, Liu and Xia, INFOCOM 2002). A delay of all reads, such as the
transmission time of a frame, is given as `latency`.

If a read is more than 5 ms too early, a new line begins with this read, because the clock of the
host was set back or the index is too large. If all reads are more than 5 ms late for 1 s, a new
line begins with the late reads, because samples were lost without notice or the clock of the host
was set forward. While reads are over 20 ms late, `settled` is false.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from checkweigher_core.records import NANOSECONDS

# Largest error of the stamps in ns that is corrected gradually. A larger error is corrected in one
# step. The step exceeds the default of the parameter clock_tolerance of the segmenter, so that the
# item on the belt gets the decision FAULT.
_STEP = 20_000_000
_WINDOW = 60.0  # duration in s of the signal to which the line is fitted
_BUCKET = 1.0  # duration in s of the signal whose points are reduced to their convex hull
_REFIT = 0.25  # time in s between two fits
# Smallest duration in s, and smallest number, of the reads from which a new line is fitted before
# it is used. Late reads begin a new line if they reach this duration and this number.
_WARM_UP = 1.0
_WARM_UP_READS = 20
_MAX_DRIFT = 0.02  # largest relative error of the nominal sample rate
_KNOWN_DRIFT = 300e-6  # largest relative change of a known sample rate
_KNOWN_AFTER = 20.0  # time in s after which the sample rate is known
_SHIFT = 5_000_000  # smallest deviation in ns of reads from the line that begins a new line
_SLEW = 2e-3  # largest relative rate at which the stamps of a settled clock approach the line
_WARM_UP_SLEW = 0.5  # largest relative rate at which stamps of an unsettled clock approach the line

_Point = tuple[int, float]  # sample index, and delay in ns relative to the nominal sample rate


@dataclass(slots=True)
class _Line:
    """Linear function of the sample index: delay in ns relative to the nominal sample rate."""

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
    """Estimator of the stamps of samples, which fits a line to the times of the reads.

    The true sample rate may differ by up to 2 % from `sample_rate` in Hz. `latency` is the shortest
    time in s from a sample to the read that returns it.

    A stamp depends only on the reads so far. In a settled clock, the stamps approach the line at a
    relative rate of at most 0.2 %, or jump to the line if they differ from it by more than 20 ms.
    `add` must be called before `stamp`, with increasing indices.
    """

    def __init__(self, sample_rate: float, *, latency: float = 0.0) -> None:
        self._rate = sample_rate
        self._period = NANOSECONDS / sample_rate
        self._latency = round(latency * NANOSECONDS)
        self._slopes = (-_MAX_DRIFT * self._period, _MAX_DRIFT * self._period)
        # Index of the first sample of the first read, and time in ns of this read.
        self._origin = 0, 0
        self._steps = 0
        self._shifts = 0
        # Mean and maximum delay in ns of the reads in the last complete bucket.
        self._delays = (0.0, 0.0)
        self._out: _Line | None = None
        self._begin(())

    def _begin(self, points: Sequence[_Point]) -> None:
        self._buckets: deque[list[_Point]] = deque()
        self._bucket: list[_Point] = list(points)
        self._bucket_delays: list[float] = []  # delays in ns of reads in `_bucket`
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
        """Whether the stamps may be used.

        The stamps may be used if at least 1 s of signal and 20 reads have been added to the present
        line, and if the latest read is at most 20 ms late.
        """
        return (
            self._fit is not None
            and not self._in_doubt
            and self._reads >= _WARM_UP_READS
            and self._end - self._from >= _WARM_UP * self._rate
        )

    def add(self, first_index: int, count: int, host_ns: int) -> None:
        """Add a read of `count` samples. The first sample has the index `first_index`.

        `host_ns` is the time in ns on the real-time clock of the host at which the last sample of
        the read arrived.
        """
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
        self._bucket_delays.append(max(late, 0.0))
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
        """Return whether reads have been late for longer than a stalled computer can explain.

        At least 20 reads must have been late, over at least 1 s of signal and 1 s of the clock of
        the host.
        """
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
        delays = self._bucket_delays
        self._delays = sum(delays) / len(delays), max(delays)
        self._bucket_delays = []
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
        """Move the stamps towards the line, beginning with the stamp of the sample `index`."""
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
        """Return the stamp of a sample in ns. `add` must have been called before."""
        assert self._out is not None
        x = index - self._origin[0]
        return self._origin[1] - self._latency + round(self._period * x + self._out.at(x))

    def figures(self) -> dict[str, float]:
        """Return values for the diagnostics, by name.

        ``clock drift ppm`` is the relative error of the nominal sample period, and ``clock offset
        ms`` is the distance of the stamps from the line. ``read jitter ms`` and ``latest read ms``
        are the mean and the maximum delay of the reads relative to the line in the last complete
        second. ``clock steps`` and ``clock shifts`` count the new lines that differ from the line
        before by more than 20 ms, and by 20 ms or less.
        """
        drift = offset = 0.0
        if self._fit is not None and self._out is not None:
            drift = self._fit.slope / self._period
            offset = self._fit.at(self._end) - self._out.at(self._end)
        return {
            'clock drift ppm': 1e6 * drift,
            'clock offset ms': 1e-6 * offset,
            'read jitter ms': 1e-6 * self._delays[0],
            'latest read ms': 1e-6 * self._delays[1],
            'clock steps': self._steps,
            'clock shifts': self._shifts,
        }
