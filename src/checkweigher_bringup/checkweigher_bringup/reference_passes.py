"""Passes of a product of known mass over a running line: the dynamic setting."""

from collections.abc import Callable
import queue
import time
from typing import Any

from rclpy.node import Node
from rclpy.serialization import serialize_message

from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import Decision, Reference
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import reference_to, verdict_from
from checkweigher_validation.accuracy.results import GRAMS

_TRAIL = 1.0  # s, in which the last product leaves the belt
# The window of such a pass is whole: it is what the training is to mend, or nothing to do with it.
_OF_USE = {Reason.SPEED_NOT_TRAINED, Reason.NO_CONVERGENCE, Reason.NO_PRODUCT}


class ReferencePasses:
    """Say of every item that passed as a whole what it weighs.

    Parameters
    ----------
    mass : float
        kg.
    wanted : int, optional
        Passes after which that is enough.

    Attributes
    ----------
    count : int
        Passes up to now; those of which there is no whole window do not count and get no mass.
    """

    def __init__(self, mass: float, wanted: int | None) -> None:
        self._mass = mass
        self._wanted = wanted
        self._news: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._last = 0.0
        self.count = 0

    @property
    def done(self) -> bool:
        """Whether there were enough, and the last one has left the belt."""
        return (
            self._wanted is not None
            and self.count >= self._wanted
            and time.monotonic() > self._last + _TRAIL
        )

    def attach(self, node: Node, put: Callable[[bytes], None]) -> None:
        """Listen with a node, and hand over serialized messages of reference_mass."""

        def hear(message: Any) -> None:
            verdict = verdict_from(message)
            if self._wanted is not None and self.count >= self._wanted:
                return
            fault = verdict.decision == Decision.FAULT and not _OF_USE.issuperset(verdict.reasons)
            if fault or verdict.t1 is None:
                self._news.put(f'a pass that was not weighed: {", ".join(verdict.reasons)}')
                return
            put(serialize_message(reference_to(Reference(verdict.t1, self._mass))))
            self.count += 1
            self._last = time.monotonic()
            of = '' if self._wanted is None else f' of {self._wanted}'
            found = (
                f'{GRAMS * verdict.mass:.3f} g, {GRAMS * (verdict.mass - self._mass):+.3f} g'
                if verdict.mass == verdict.mass
                else f'no mass yet: {", ".join(verdict.reasons)}'
            )
            self._news.put(f'pass {self.count}{of}: {found}')

        node.create_subscription(
            ports.VERDICT.type, ports.VERDICT.name, hear, ports.VERDICT.stage_qos
        )

    def news(self) -> list[str]:
        """Return a line for each pass since the last call."""
        lines = []
        while not self._news.empty():
            lines.append(self._news.get())
        return lines
