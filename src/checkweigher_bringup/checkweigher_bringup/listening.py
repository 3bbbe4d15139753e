# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes that receive the results of a running graph."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
import os
import queue
import time
from typing import Any

from checkweigher_core.records import MassEstimate, Reference, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.ports import Port
from checkweigher_dsp.pipeline.line import Weighing
from checkweigher_validation.accuracy.results import ItemResult, ResultJoiner

# Maximum number of estimates that wait for their verdict, and of verdicts that wait for their
# estimate.
_MAX_UNPAIRED = 1000
_MAX_REFERENCES = 100  # maximum number of known masses that wait for the verdict of their item
_ESTIMATE_PATIENCE = 1.0  # time in s after which a verdict is shown without its estimate


class ResultListener(PortNode):
    """Node that pairs each verdict of a lane with its mass estimate.

    The subscriptions also request earlier messages, because a node may publish a result before it
    discovers the subscription. Any thread may read the pairs from the queue `weighings`. `pairs` is
    the number of pairs so far. `heard` is the time in s, on the monotonic clock, of the latest
    pair, or of the start if there is no pair yet. A subclass or a caller may set `heard` to a later
    time.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        # The queue is not a SimpleQueue, because `SimpleQueue.get` of CPython 3.11 may never return
        # if a signal arrives just before the timeout.
        self.weighings: queue.Queue[Weighing] = queue.Queue()
        self.heard = time.monotonic()
        self.pairs = 0
        # Estimates without a verdict, and verdicts without an estimate, by the number of the
        # estimate. Each verdict is stored with its arrival time in s.
        self._estimates: dict[int, MassEstimate] = {}
        self._verdicts: dict[int, tuple[float, Verdict]] = {}
        self.listen(ports.MASS_ESTIMATE, self._on_estimate)
        self.listen(ports.VERDICT, self._on_verdict)

    def count_drivers(self) -> int:
        """Return the number of drivers in this lane, counted as publishers of samples."""
        return int(self.count_publishers(self.resolve_topic_name(ports.LOAD_CELL_SAMPLES.name)))

    def listen(self, port: Port, callback: Callable[[Any], None]) -> None:
        """Subscribe to a port of the lane, and call `callback` with each record."""
        self.subscribe(port, callback, qos=port.qos)

    def _on_estimate(self, estimate: MassEstimate) -> None:
        if estimate.item_id in self._verdicts:
            self._pair(estimate, self._verdicts.pop(estimate.item_id)[1])
        else:
            self._estimates[estimate.item_id] = estimate
            _forget_oldest(self._estimates)

    def _on_verdict(self, verdict: Verdict) -> None:
        if not verdict.estimate_id:
            self._pair(_estimate_of(verdict), verdict)
        elif verdict.estimate_id in self._estimates:
            self._pair(self._estimates.pop(verdict.estimate_id), verdict)
        else:
            self._verdicts[verdict.estimate_id] = time.monotonic(), verdict
            _forget_oldest(self._verdicts)

    def _pair(self, estimate: MassEstimate, verdict: Verdict) -> None:
        self.heard = time.monotonic()
        self.pairs += 1
        # The pair gets the item number of the verdict, because the number of the estimate may be
        # reused.
        self.weighings.put(Weighing(replace(estimate, item_id=verdict.item_id), verdict))


def _estimate_of(verdict: Verdict) -> MassEstimate:
    """Return an estimate that contains only the values which a verdict repeats.

    All other values of the estimate are unknown. If the verdict has neither reasons nor an
    estimate, the reason of the returned estimate is `Reason.NO_ESTIMATE`.
    """
    return MassEstimate(
        verdict.item_id,
        verdict.t1,
        None,
        verdict.t3,
        verdict.reasons or (() if verdict.estimate_id else (Reason.NO_ESTIMATE,)),
        mass=verdict.mass,
        std_dev=verdict.std_dev,
    )


def _forget_oldest(unpaired: dict[int, Any]) -> None:
    """Remove the oldest record if there are more than `_MAX_UNPAIRED` records.

    The estimate or verdict that belongs to the oldest record was probably lost.
    """
    if len(unpaired) > _MAX_UNPAIRED:
        del unpaired[next(iter(unpaired))]


class EchoNode(ResultListener):
    """Node that receives the results and the known masses of a lane."""

    def __init__(self, name: str = 'echo') -> None:
        super().__init__(name)
        self.create_timer(_ESTIMATE_PATIENCE / 2, self._pair_overdue)
        self._references: deque[Reference] = deque(maxlen=_MAX_REFERENCES)
        self.listen(ports.REFERENCE_MASS, self._references.append)

    def _pair_overdue(self) -> None:
        # An estimate may never arrive, for example because the identifier has ended and no longer
        # keeps it for late subscribers. A verdict without an estimate is therefore paired with the
        # values of the estimate that the verdict repeats.
        for key, (arrival, verdict) in list(self._verdicts.items()):
            if time.monotonic() - arrival > _ESTIMATE_PATIENCE:
                del self._verdicts[key]
                self._pair(_estimate_of(verdict), verdict)

    def result(self, weighing: Weighing) -> ItemResult:
        """Return a weighing with the known mass of its item, if the line published one."""
        return ResultJoiner((), list(self._references)).join(weighing)

    def place(self) -> str:
        """Return a text with the name of the topic of the verdicts and the ROS domain."""
        domain = os.environ.get('ROS_DOMAIN_ID') or '0'
        return f'{self.resolve_topic_name(ports.VERDICT.name)} in ROS_DOMAIN_ID {domain}'

    def silence(self) -> str:
        """Return a text that explains why no verdict has arrived."""
        for topic in (ports.LOAD_CELL_SAMPLES, ports.PHOTO_EYES, ports.VERDICT):
            name = self.resolve_topic_name(topic.name)
            if self.count_publishers(name) == 0:
                return (
                    f'no verdict on {self.place()}: no node publishes {name}; start the line, or '
                    'give the --namespace and ROS_DOMAIN_ID of the running line'
                )
        return f'no verdict on {self.place()}: the line is running, but no product has passed'
