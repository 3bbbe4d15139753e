# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the reject node keeps back while it asks the driver what it has missed."""

from collections import deque
from dataclasses import dataclass, field
from functools import partial
import math
import time

from checkweigher_dsp.records import EyeEdge, LineHistory, MassEstimate

# s, in which a driver that has a status answers; then the line is asked to stop until it does.
# Without the answer a verdict or a number could be given twice, so an item that waits too long for
# the rejector is a FAULT. A driver that sends no status is a third-party one without the service:
# the node stops waiting after `_NO_STATUS` if it sends edges, else after `_NO_EDGES`.
_NO_ANSWER, _NO_STATUS, _NO_EDGES = 30.0, 1.0, 5.0
_LOST_ANSWER = 2.0  # s, after which the driver is asked again
_ON_THE_WAY = 0.2  # s, for edges that the answer has overtaken
_MAX_KEPT = 10_000  # of each: far more than a belt takes that the line has asked to stop

Arrivals = deque[tuple[EyeEdge, int | None]]  # edges, each with the time at which it came


@dataclass
class Recall:
    """A question to the driver, and what comes while the answer is not there.

    It is asked once more as soon as an edge has come that the answer ends before: the next answer
    has what was sent between them.
    """

    driver_heard: bool = False  # it has said what stream this is
    ended: bool = False  # the driver has said that the stream is over
    # What is kept back.
    edges: Arrivals = field(default_factory=partial(deque, maxlen=_MAX_KEPT))
    estimates: deque[MassEstimate] = field(default_factory=partial(deque, maxlen=_MAX_KEPT))
    over: Arrivals = field(default_factory=partial(deque, maxlen=_MAX_KEPT))  # of streams before
    history: LineHistory | None = None  # the answer
    _asked: float | None = None
    _began: float | None = None
    _answered: float | None = None
    _has_first: bool = False  # whether the answer has the first edge that has come

    @property
    def waiting(self) -> bool:
        """Whether time alone may end it."""
        return self._began is not None

    @property
    def overdue(self) -> bool:
        """Whether a driver should have answered by now."""
        if self._began is None or self._answered is not None:
            return False
        return self._waits_since(self._began) > _NO_ANSWER

    def hear_driver(self, *, ended: bool) -> None:
        """Note what the driver says of its stream."""
        self.driver_heard, self.ended = True, ended
        self.begin()

    def begin(self) -> None:
        """Keep back what comes from now on."""
        self._began = time.monotonic() if self._began is None else self._began

    def begin_stream(self) -> None:
        """Note that the driver has begun another stream: what was kept back is of one before."""
        self.over.extend(self.edges)
        self.edges.clear()
        self.estimates.clear()
        self.history = self._asked = self._answered = None
        self._has_first = False

    @property
    def may_ask(self) -> bool:
        """Whether the driver is to be asked, or asked again: DDS loses an answer at times."""
        if not self.driver_heard or (self._answered is not None and not self._may_lack_edges):
            return False
        if self._asked is None:
            return True
        was_answered = self._answered is not None and self._asked < self._answered
        return was_answered or self._waits_since(self._asked) > _LOST_ANSWER

    @property
    def _may_lack_edges(self) -> bool:
        """Whether the answer ends before the first edge that has come: one between may lack."""
        if self._has_first or self.history is None or not self.edges:
            return False
        last = max((edge.stamp for edge in self.history.edges), default=None)
        return last is not None and last < self.edges[0][0].stamp

    def ask(self) -> bool:
        """Note that the driver is asked; return whether its answer has the first edge that came.

        It has if that has come before the question. Where it lacks the edge all the same, the edge
        is not the driver's.
        """
        self._asked = time.monotonic()
        return bool(self.edges)

    def answer(self, history: LineHistory, *, has_first: bool) -> None:
        """Take the answer to a question; one to a question before that comes too late."""
        if has_first or not self._has_first:
            self.history, self._answered = history, time.monotonic()
            self._has_first = has_first

    def is_over(
        self, weigh_length: float | None, *, driver: bool, status: bool, edges: bool
    ) -> bool:
        """Tell whether nothing has to be kept back any more, with the answer or without.

        Without a `weigh_length` edges are no items. `driver` tells whether a driver is there that
        answers, sooner or later; `status` and `edges` whether anyone publishes these.
        """
        if self._began is None:
            return False
        if self.history is None or self._answered is None:
            patience = _NO_ANSWER if status else _NO_STATUS if edges else _NO_EDGES
            return self._waits_since(self._began) > (math.inf if driver else patience)
        if not self.history.edges:
            return True
        # From the first edge on that has come, none is missing: before that, some may be due.
        waits = self._waits_since(self._answered)
        complete = not self._may_lack_edges and (bool(self.edges) or waits > _ON_THE_WAY)
        return (complete and weigh_length is not None) or waits > _NO_ANSWER

    @staticmethod
    def _waits_since(moment: float) -> float:
        return time.monotonic() - moment
