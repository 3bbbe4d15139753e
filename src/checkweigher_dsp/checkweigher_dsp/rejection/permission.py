# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rule for the permission to run the line."""

from collections.abc import Iterable, Mapping

from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.records import NANOSECONDS, StreamStatus

_HINTS = {
    'samples': 'check load cell, driver and segmenter: no new samples are processed',
    'eyes': 'check that the driver runs: no node publishes photo_eyes',
    'load cell': 'check that the driver runs: no node publishes load_cell/info',
}
_STAGE_HINT = 'check its process: it has ended, hangs or is halted'
_SAMPLES = 'samples'


class PermissionRule:
    """Rule for the permission to run the line.

    The line may run if all `stages` have sent a sign of life in the last `fresh_time` s, all inputs
    have a publisher, and no stop is requested. Without `deadlines`, only a stop request withdraws
    the permission. A status of the segmenter with a new number of processed samples is a further
    sign of life, which must be as recent as the signs of the stages. Apart from `fresh_time`, times
    are in ns on a monotonic clock.
    """

    def __init__(self, fresh_time: float, stages: Iterable[str] = (), *, deadlines: bool) -> None:
        self.deadlines = deadlines
        self._fresh_time = round(NANOSECONDS * fresh_time)
        self._progress = (0, 0)  # stream and number of processed samples in the latest status.
        # Time in ns of the latest sign of life of each stage, or None before its first sign.
        self._signs: dict[str, int | None] = dict.fromkeys((*stages, _SAMPLES))
        self._missing: tuple[str, ...] = ()
        self._given = False

    def add_progress(self, status: StreamStatus, now: int) -> None:
        """Add a status of the segmenter that arrived at `now`.

        The status is a sign of life if its number of processed samples is new and not 0.
        """
        if status.samples and (status.stream, status.samples) != self._progress:
            self._progress = status.stream, status.samples
            self.add_sign(_SAMPLES, now)

    def add_sign(self, stage: str, now: int) -> None:
        """Add a sign of life of a stage that arrived at `now`."""
        self._signs[stage] = now

    def may_run(self, present: Mapping[str, bool], now: int, *, stopped: bool) -> bool:
        """Return whether the line may run at `now`.

        `present` states for each input whether it has a publisher, and `stopped` states whether a
        stop is requested.
        """
        old = now - self._fresh_time
        signs = {name: sign is not None and sign >= old for name, sign in self._signs.items()}
        self._missing = tuple(name for name, well in {**present, **signs}.items() if not well)
        self._given = not stopped and not (self._missing and self.deadlines)
        return self._given

    def fresh_for(self, now: int) -> int:
        """Return the time in ns until the first sign of life expires, or 0 if one has expired.

        The result is also 0 if one of the required signs of life has never arrived.
        """
        oldest = min(sign or 0 for sign in self._signs.values())
        return max(oldest + self._fresh_time - now, 0)

    def finding(self) -> Finding:
        """Return the finding on the last result of `may_run` (aspect Permission)."""
        concerns = [
            Concern(Level.WARN, f'withdrawn: no {name}', _HINTS.get(name, _STAGE_HINT))
            for name in self._missing
            if self.deadlines and self._signs[_SAMPLES] is not None  # not while the line starts
        ]
        return conclude('Permission', 'given' if self._given else 'withdrawn', concerns)
