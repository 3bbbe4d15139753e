# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rejects by the inspection devices of a line: metal detectors, X-ray devices and cameras.

The devices are installed at known distances before or behind the infeed eye. A device answers for
an item within its answer time after the item has passed the device. The verdict on an item waits
until the answer times of all devices are over, so that the verdict is final. An item that a
device rejects is a FAULT with a reason for the device. An item is a FAULT with the reason
NotInspected if its verdict is due before the answer times are over, or if a device was not running.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    ExternalReject,
    Item,
    MachineConditions,
    StopRequest,
    Verdict,
)
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_dsp.rejection.parameters import RejectParameters

_REASONS = {
    'metal': Reason.METAL_DETECTED,
    'xray': Reason.XRAY_DETECTED,
    'vision': Reason.VISION_REJECTED,
}
_MAX_SIGNALS = 1_000  # maximum number of rejects that wait for their items
_MAX_JUDGED = 400  # maximum number of stored verdicts
_MAX_OUTAGES = 100  # maximum number of stored outages
_NAMED_PATIENCE = NANOSECONDS  # waiting time in ns of a reject that names its item.
# Lowest belt speed in m/s at which rejects without an item number wait long enough for their items.
_SLOWEST_BELT = 0.1
_LATENESS = 2 * NANOSECONDS  # largest delay of an edge behind the samples in ns
_EVER = 2**62  # time in ns beyond any stamp


class Passage(NamedTuple):
    """Passage of an item over the weigh belt. Times are in ns."""

    t1: int
    length: int  # t2 - t1
    transit: int  # t3 - t1
    weigh_length: float  # distance between the eyes in m

    @classmethod
    def of(cls, item: Item, weigh_length: float | None) -> 'Passage | None':
        """Return the passage of an item, or None if it is not completely known."""
        if item.t1 is None or item.t2 is None or item.t3 is None or not weigh_length:
            return None
        return cls(item.t1, item.t2 - item.t1, item.t3 - item.t1, weigh_length)


class Span(NamedTuple):
    """Period between two time stamps in ns."""

    begin: int
    end: int


@dataclass(slots=True, eq=False)
class _Signal:
    """Reject by an inspection device, which waits for its item."""

    reject: ExternalReject
    # Time in ns on the clock of arrivals at which the reject is removed. A reject that was not
    # applied to an item before it is removed counts as missed.
    forget_at: int
    used: bool = False  # whether the reject was applied to an item


class Inspections:
    """Assignment of the rejects of inspection devices to items. Stamps and times are in ns."""

    def __init__(self, parameters: RejectParameters) -> None:
        self.parameters = parameters  # parameters, which may be replaced at any time.
        # Stop request for the first missed reject, or None. The caller must pass the request on and
        # set `missed` to None.
        self.missed: StopRequest | None = None
        self._signals: deque[_Signal] = deque(maxlen=_MAX_SIGNALS)
        # Latest verdicts of this stream, which are final, with the passages of the items.
        self.judged: deque[tuple[Verdict, Passage | None]] = deque(maxlen=_MAX_JUDGED)
        # Periods in which at least one device did not run. Before the first report, the devices
        # count as not running. The last period ends at `_EVER` until all devices run again.
        self._outages = deque([Span(-_EVER, _EVER)], maxlen=_MAX_OUTAGES)

    def look(self, conditions: MachineConditions, stamp: int, *, heard: bool) -> None:
        """Store whether all devices run at `stamp` in ns.

        The devices run if `conditions` are known and contain no inspection fault, and if `heard` is
        true. `heard` states whether a node publishes rejects.
        """
        fault = StopReason.INSPECTION_FAULT in conditions.conditions
        running = conditions.known and not fault and heard
        # Date an outage back by `_LATENESS`, because the outage may have begun before the latest
        # edge, which sets the stamp.
        self.set_running(running, stamp if running else stamp - _LATENESS)

    def set_running(self, running: bool, stamp: int) -> None:
        """Store whether all devices are running from `stamp`, in ns, until the next call."""
        last = self._outages[-1]
        if running and last.end == _EVER:
            self._outages[-1] = Span(last.begin, stamp)
        elif not running and last.end != _EVER:
            self._outages.append(Span(stamp, _EVER))

    def add(self, reject: ExternalReject, weigh_length: float | None, now: int) -> None:
        """Add a reject that arrived at `now`, possibly after the verdict on its item.

        The reject is missed, and `missed` is set, if its item was already accepted, or if the
        reject names neither an item nor a known device. `weigh_length` is the distance between the
        eyes in m.
        """
        for verdict, passage in reversed(self.judged):
            if self._is_of(reject, verdict.item_id, passage):
                if verdict.decision is Decision.ACCEPT:
                    self._miss(reject, verdict.item_id, 'the item was already accepted')
                return
        if not reject.item_id and reject.device not in self.parameters.devices:
            self._miss(reject, 0, 'the device is not in reject.inspections')
            return
        patience = _NAMED_PATIENCE
        if not reject.item_id:
            place = self.parameters.devices.index(reject.device)
            way = abs(self.parameters.inspection_distances[place]) + 2 * (weigh_length or 0.0)
            patience = round(NANOSECONDS * way / _SLOWEST_BELT) + _LATENESS
        self._signals.append(_Signal(reject, now + patience))

    def over_at(self, passage: Passage | None) -> int | None:
        """Return the stamp at which the answer times of all devices are over for an item.

        The result is None if there are no devices, or if the passage of the item is unknown.
        """
        return max((span.end for _, span in self._spans(passage)), default=None)

    def _spans(self, passage: Passage | None) -> Iterator[tuple[str, Span]]:
        """Yield each device with the period in which it answers for an item."""
        if passage is None:
            return
        known = self.parameters
        slack = round(NANOSECONDS * known.inspection_tolerance)
        for device, distance, answer in zip(
            known.devices, known.inspection_distances, known.inspection_times, strict=True
        ):
            begin = passage.t1 + round(distance / passage.weigh_length * passage.transit)
            end = begin + passage.length + round(NANOSECONDS * answer)
            yield device, Span(begin - slack, end + slack)

    def heed(self, verdict: Verdict, passage: Passage | None, over: bool | None) -> Verdict:
        """Return a verdict, changed to a FAULT if a device rejected or did not inspect the item.

        The mass is not changed. `over` states whether the answer times of all devices are over, or
        is None without a clock. If the `passage` is None, only rejects that name the item are
        applied.
        """
        reasons = []
        for signal in self._signals:
            if self._is_of(signal.reject, verdict.item_id, passage):
                signal.used = True
                reasons.append(_REASONS.get(signal.reject.device, Reason.EXTERNAL_REJECT).value)
        if over is not None and (not over or self._was_out(passage)):
            reasons.append(Reason.NOT_INSPECTED.value)
        if not reasons:
            return verdict
        known = dict.fromkeys((*verdict.reasons, *reasons))
        return replace(verdict, decision=Decision.FAULT, reasons=tuple(known))

    def _was_out(self, passage: Passage | None) -> bool:
        return any(
            out.begin <= span.end and span.begin <= out.end
            for _, span in self._spans(passage)
            for out in self._outages
        )

    def _is_of(self, reject: ExternalReject, item_id: int, passage: Passage | None) -> bool:
        if reject.item_id:
            return reject.item_id == item_id
        stamp = reject.stamp
        return stamp is not None and any(
            device == reject.device and span.begin <= stamp <= span.end
            for device, span in self._spans(passage)
        )

    @property
    def due(self) -> int | None:
        """Time on the clock of arrivals at which the next reject counts as missed, or None."""
        return min((signal.forget_at for signal in self._signals if not signal.used), default=None)

    def advance(self, now: int) -> None:
        """Remove the rejects that expire by `now`, and report rejects without an item as missed."""
        for signal in self._signals:
            if signal.forget_at <= now and not signal.used:
                self._miss(signal.reject, signal.reject.item_id, 'no item was at the device')
        kept = [signal for signal in self._signals if signal.forget_at > now]
        self._signals = deque(kept, maxlen=_MAX_SIGNALS)

    def _miss(self, reject: ExternalReject, item_id: int, why: str) -> None:
        said = f'{reject.device}: {reject.text}' if reject.text else reject.device
        self.missed = self.missed or StopRequest(
            StopReason.MISSED_EXTERNAL_REJECT, item_id, reject.stamp, f'{said}: {why}'
        )
