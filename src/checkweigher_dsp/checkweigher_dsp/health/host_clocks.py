# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Offset between the clocks of two hosts, from messages there and back.

The estimate is that of NTP (RFC 5905, section 8) with its bound: the offset cannot be off by more
than half of the round trip, however that is shared between there and back. The exchange with the
shortest round trip says the most; with time the clocks may drift from what it said. Where the
round trip is too long to tell, chrony may: two clocks that it keeps by the same reference are no
further apart than the bounds of their errors together.
"""

from collections import deque
from dataclasses import dataclass
import math

from checkweigher_dsp.health.findings import MINUTE, Concern, Finding, Level, conclude
from checkweigher_dsp.records import NANOSECONDS

LARGEST_OFFSET = 0.0002  # s, up to which stamps of two hosts are of one clock
SUPERVISOR = 'supervisor_'  # node of a host that tells of the clocks of others, with its name
_CLOCK_OF = 'Clock of '
_SILENCE = 5.0  # s, five of its periods
_DRIFT = 1e-4  # relative, of two clocks that nothing keeps
_KEPT = 1000


@dataclass(frozen=True, slots=True)
class KeptClock:
    """A clock that chrony keeps: by which reference, and the bound of its error, s."""

    reference: int  # identifier (RFC 5905, section 7.3)
    bound: float


@dataclass(frozen=True, slots=True)
class Exchange:
    """A message to another host and its answer; times in ns, each of the clock of its host."""

    sent: int
    heard: int  # by the other one
    answered: int  # by the other one
    came: int
    kept: KeptClock | None = None  # what chrony says there

    @property
    def offset(self) -> float:
        """Clock of the other host less that of this one, s."""
        return ((self.heard - self.sent) + (self.answered - self.came)) / 2 / NANOSECONDS

    @property
    def uncertainty(self) -> float:
        """By how much the offset can be off, s."""
        return ((self.came - self.sent) - (self.answered - self.heard)) / 2 / NANOSECONDS


class HostClockWatch:
    """Watch of the clock of another host, by the exchanges of the last minute."""

    def __init__(self) -> None:
        self._exchanges: deque[tuple[float, Exchange]] = deque(maxlen=_KEPT)

    def add(self, now: float, exchange: Exchange) -> None:
        """Take an exchange whose answer came at `now`, s of the monotonic clock.

        One that no clocks can have shown, as when one was set meanwhile, is passed over.
        """
        if exchange.uncertainty >= 0 and exchange.answered >= exchange.heard:
            self._exchanges.append((now, exchange))

    def estimate(self, now: float) -> tuple[float, float]:
        """Return offset and its uncertainty at `now`, s; NaN and infinity if nothing is known."""
        while self._exchanges and self._exchanges[0][0] <= now - MINUTE:
            self._exchanges.popleft()
        known = [(e.uncertainty + _DRIFT * (now - t), e.offset) for t, e in self._exchanges]
        uncertainty, offset = min(known, default=(math.inf, math.nan))
        return offset, uncertainty

    def finding(self, now: float, host: str, own: KeptClock | None = None) -> Finding:
        """Return the aspect Clock of a host: OK if the clocks surely agree.

        `own` is what chrony says of the clock of this host.
        """
        offset, uncertainty = self.estimate(now)
        kept = self._kept_within(own)
        values = {
            'offset_ms': 1e3 * offset, 'uncertainty_ms': 1e3 * uncertainty,
            'bound_by_chrony_ms': 1e3 * kept,
        }  # fmt: skip
        said = f'{1e3 * offset:+.3f} ms, certain to {1e3 * uncertainty:.3f} ms'
        limit = f'{1e3 * LARGEST_OFFSET:g} ms'
        found = []
        if not math.isfinite(uncertainty):
            hint = 'check that run --line runs there, and that UDP passes'
            found.append(Concern(Level.ERROR, f'the clock of {host} is not known', hint))
        elif abs(offset) - uncertainty > LARGEST_OFFSET:
            hint = 'keep both by PTP or chrony; until then take samples and edges on one host'
            found.append(Concern(Level.ERROR, f'the clock of {host} is off by {said}', hint))
        elif abs(offset) + uncertainty > LARGEST_OFFSET < kept:
            hint = f'the network is too slow to show {limit}; chrony on both hosts may know it'
            found.append(Concern(Level.WARN, f'the clock of {host}: {said}', hint))
        elif abs(offset) + uncertainty > LARGEST_OFFSET:
            said = f'chrony keeps both clocks within {1e3 * kept:.3f} ms'
        return conclude(f'{_CLOCK_OF}{host}', said, found, values)

    def _kept_within(self, own: KeptClock | None) -> float:
        """Return how far apart two clocks can be that chrony keeps, s; infinity if not known."""
        other = self._exchanges[-1][1].kept if self._exchanges else None
        if own is None or other is None or own.reference != other.reference:
            return math.inf
        return own.bound + other.bound


class ClockBoard:
    """What the supervisors of hosts last said of the clocks of the others."""

    def __init__(self) -> None:
        self._said: dict[tuple[str, str], tuple[float, Level]] = {}  # by teller and subject

    def add(self, now: float, name: str, level: Level) -> None:
        """Take a status of the diagnostics that came at `now`, s; others are passed over."""
        node, _, aspect = name.strip('/').partition(': ')
        if node.startswith(SUPERVISOR) and aspect.startswith(_CLOCK_OF):
            hosts = node.removeprefix(SUPERVISOR), aspect.removeprefix(_CLOCK_OF)
            self._said[hosts] = now, level

    def agree(self, now: float, one: str, other: str) -> bool:
        """Return whether the clocks of two hosts, by name, agree: one says so, none contradicts."""
        said = [
            level
            for hosts in ((one, other), (other, one))
            for when, level in [self._said.get(hosts, (-math.inf, Level.STALE))]
            if now - when <= _SILENCE
        ]
        return Level.OK in said and Level.ERROR not in said
