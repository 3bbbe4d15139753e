# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rejects by other inspection devices of the line: metal detector, X-ray, vision.

A device stands at its distance from the infeed eye, before or behind it, and answers for an item at
the latest its answer time after the item has passed it. The verdict on an item waits until all
devices have had that time; what one of them rejects is a FAULT with the device's reason. An item
whose time would be over too late for the rejector, or that passed while a device did not run, is
NotInspected. So each item still has one verdict, and the verdict is never changed.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from checkweigher_core.records import NANOSECONDS, Decision, ExternalReject, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.rejection.parameters import RejectParameters

_REASONS = {
    'metal': Reason.METAL_DETECTED,
    'xray': Reason.XRAY_DETECTED,
    'vision': Reason.VISION_REJECTED,
}
_MAX_SIGNALS = 1_000
_MAX_JUDGED = 400
_MAX_OUTAGES = 100
_NAMED_PATIENCE = NANOSECONDS  # for the verdict on an item that a device names
_SLOWEST_BELT = 0.1  # m/s; an item that takes longer than on it has no place
LATENESS = 2 * NANOSECONDS  # of edges behind their samples


class Passage(NamedTuple):
    """The way of an item over the weigh belt: when it begins to enter, and for how long, ns."""

    t1: int
    length: int  # t2 - t1
    transit: int  # t3 - t1, over the weigh length


class Span(NamedTuple):
    """The time in which a device answers for an item, stamps in ns."""

    begin: int
    end: int


@dataclass(slots=True, eq=False)
class _Signal:
    """What a device said; `forget_at` is when its item should have come, on the arrival clock."""

    reject: ExternalReject
    forget_at: int
    used: bool = False


class Missed(NamedTuple):
    """A reject that came too late or of no item that the eyes have shown: the line has to stop."""

    item_id: int
    stamp: int | None
    text: str


class Inspections:
    """What the inspection devices have said, and the items that it is of.

    Stamps and times are in ns. `missed` has the rejects that no verdict could heed, for the caller
    to take away.
    """

    def __init__(self, parameters: RejectParameters) -> None:
        self.parameters = parameters
        self.missed: list[Missed] = []
        self._signals: deque[_Signal] = deque(maxlen=_MAX_SIGNALS)
        self._judged: deque[tuple[Verdict, Passage | None]] = deque(maxlen=_MAX_JUDGED)
        self._outages: deque[Span] = deque(maxlen=_MAX_OUTAGES)
        self._out_since: int | None = -(2**62)  # until it is known that the devices run

    def set_running(self, running: bool, stamp: int) -> None:
        """Note that the devices run, or that one does not, from `stamp` on."""
        if running and self._out_since is not None:
            self._outages.append(Span(self._out_since, stamp))
            self._out_since = None
        elif not running and self._out_since is None:
            self._out_since = stamp

    def add(self, reject: ExternalReject, weigh_length: float | None, now: int) -> None:
        """Take a reject that came at `now`; see whether its item has its verdict already."""
        for verdict, passage in reversed(self._judged):
            if self._is_of(reject, verdict.item_id, passage, weigh_length):
                if verdict.decision is Decision.ACCEPT:
                    self._miss(reject, verdict.item_id, 'its item was accepted before')
                return
        if not reject.item_id and reject.device not in self.parameters.devices:
            self._miss(reject, 0, 'the device is not in reject.inspections')
            return
        self._signals.append(_Signal(reject, now + self._patience(reject, weigh_length)))

    def _patience(self, reject: ExternalReject, weigh_length: float | None) -> int:
        """Return how long the item of a reject can take to its verdict, ns, on the slowest belt."""
        if reject.item_id:
            return _NAMED_PATIENCE
        way = abs(self._distance(reject.device)) + 2 * (weigh_length or 0.0)
        return round(NANOSECONDS * way / _SLOWEST_BELT) + LATENESS

    def _distance(self, device: str) -> float:
        place = self.parameters.devices.index(device)
        return self.parameters.inspection_distances[place]

    def over_at(self, passage: Passage | None, weigh_length: float | None) -> int | None:
        """Return the stamp at which all devices have answered for an item, None if none has to."""
        spans = [span for _, span in self._spans(passage, weigh_length)]
        return max((span.end for span in spans), default=None)

    def _spans(
        self, passage: Passage | None, weigh_length: float | None
    ) -> Iterator[tuple[str, Span]]:
        """Yield each device with the time in which it answers for an item."""
        known = self.parameters
        if passage is None or not weigh_length:
            return
        slack = round(NANOSECONDS * known.inspection_tolerance)
        for device, distance, answer in zip(
            known.devices, known.inspection_distances, known.inspection_times, strict=True
        ):
            begin = passage.t1 + round(distance / weigh_length * passage.transit)
            end = begin + passage.length + round(NANOSECONDS * answer)
            yield device, Span(begin - slack, end + slack)

    def heed(
        self, verdict: Verdict, passage: Passage | None, weigh_length: float | None,
        over: bool | None,
    ) -> Verdict:  # fmt: skip
        """Return the verdict on an item with what the devices have said of it.

        `over` tells whether they have had their time, None where nothing is waited for. Of an item
        whose place is not known, which is a FAULT anyway, only a device that names it says
        something.
        """
        found = [
            signal
            for signal in self._signals
            if self._is_of(signal.reject, verdict.item_id, passage, weigh_length)
        ]
        reasons = [reason_of(signal.reject.device).value for signal in found]
        for signal in found:
            signal.used = True
        if over is not None and (not over or self._was_out(passage, weigh_length)):
            reasons.append(Reason.NOT_INSPECTED.value)
        return with_reasons(verdict, reasons)

    def _was_out(self, passage: Passage | None, weigh_length: float | None) -> bool:
        spans = [span for _, span in self._spans(passage, weigh_length)]
        if self._out_since is not None and any(self._out_since <= span.end for span in spans):
            return True
        return any(
            out.begin <= span.end and span.begin <= out.end
            for out in self._outages
            for span in spans
        )

    def judged(self, verdict: Verdict, passage: Passage | None) -> None:
        """Note the verdict that an item has got."""
        self._judged.append((verdict, passage))

    def _is_of(
        self, reject: ExternalReject, item_id: int, passage: Passage | None,
        weigh_length: float | None,
    ) -> bool:  # fmt: skip
        if reject.item_id:
            return reject.item_id == item_id
        stamp = reject.stamp
        return stamp is not None and any(
            device == reject.device and span.begin <= stamp <= span.end
            for device, span in self._spans(passage, weigh_length)
        )

    @property
    def due(self) -> int | None:
        """When the next reject without an item is missed, on the arrival clock."""
        open_ones = (signal.forget_at for signal in self._signals if not signal.used)
        return min(open_ones, default=None)

    def advance(self, now: int) -> None:
        """Miss the rejects whose item should have come by `now`."""
        for signal in self._signals:
            if signal.forget_at <= now and not signal.used:
                self._miss(signal.reject, signal.reject.item_id, 'no item was there')
        kept = [signal for signal in self._signals if signal.forget_at > now]
        self._signals = deque(kept, maxlen=_MAX_SIGNALS)

    def restart(self) -> None:
        """Begin a new stream: its stamps say nothing of what was judged before."""
        self._judged.clear()

    def _miss(self, reject: ExternalReject, item_id: int, why: str) -> None:
        said = f'{reject.device}: {reject.text}' if reject.text else reject.device
        self.missed.append(Missed(item_id, reject.stamp, f'{said}: {why}'))


def reason_of(device: str) -> Reason:
    """Return the reason of what a device rejects."""
    return _REASONS.get(device, Reason.EXTERNAL_REJECT)


def with_reasons(verdict: Verdict, reasons: Sequence[str]) -> Verdict:
    """Return a verdict as a FAULT for further reasons; the mass stays."""
    if not reasons:
        return verdict
    known = tuple(dict.fromkeys((*verdict.reasons, *reasons)))
    return replace(verdict, decision=Decision.FAULT, reasons=known)
