# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Products that the rejector may have missed, which stop the line until a person has looked."""

from enum import Enum, auto

_MAX_MISSED = 3  # largest number of products whose texts are kept
_MORE = 'and others'


class Latch(Enum):
    """State of the latch that stops the line after a missed product."""

    CLEAR = auto()
    PENDING = auto()  # the latch is set, and the stop request does not show all products yet
    SHOWN = auto()  # the latch is set, and the stop request shows all missed products


class LatchEvent(Enum):
    """Event that changes the latch."""

    MISS = auto()  # the rejector may have missed a product
    SHOW = auto()  # the stop request shows all missed products
    FORGET = auto()  # a restart of the node reject may have cancelled its stop request
    RUN = auto()  # the stop request was reset
    RESET = auto()  # the service reset_outputs was called


# If a stop request that showed a product is reset, a person has looked for the product. A stop
# request that is reset before it showed the product had another reason. All other pairs of state
# and event change nothing.
_TRANSITIONS = {
    (Latch.CLEAR, LatchEvent.MISS): Latch.PENDING,
    (Latch.PENDING, LatchEvent.SHOW): Latch.SHOWN,
    (Latch.PENDING, LatchEvent.RESET): Latch.CLEAR,
    (Latch.SHOWN, LatchEvent.MISS): Latch.PENDING,
    (Latch.SHOWN, LatchEvent.FORGET): Latch.PENDING,
    (Latch.SHOWN, LatchEvent.RUN): Latch.CLEAR,
    (Latch.SHOWN, LatchEvent.RESET): Latch.CLEAR,
}


class MissedProducts:
    """Latch that stops the line, with the messages `texts` on the missed products.

    `looked_at` is the time in ns of the last release of the latch by a person, or None.
    """

    def __init__(self) -> None:
        self.state = Latch.CLEAR
        self.looked_at: int | None = None
        self.texts: tuple[str, ...] = ()
        self._stopped = False  # previous result of `stop`

    @property
    def text(self) -> str:
        """Messages on the missed products in one line, empty if no product is missed."""
        return '; '.join(self.texts)

    def add(self, text: str) -> None:
        """Add the message on a product that may have been missed."""
        if text in self.texts:
            return
        named = self.texts[:_MAX_MISSED]
        self.texts = (*named, text if len(named) < _MAX_MISSED else _MORE)
        self.take(LatchEvent.MISS)

    def take(self, event: LatchEvent) -> None:
        """Change the state of the latch by an event."""
        self.state = _TRANSITIONS.get((self.state, event), self.state)
        if self.state is Latch.CLEAR:
            self.texts = ()

    def stop(self, now: int) -> bool:
        """Return whether the line has to stop because of a missed product."""
        stopped, self._stopped = self._stopped, self.state is not Latch.CLEAR
        if stopped and not self._stopped:
            self.looked_at = now
        return self._stopped
