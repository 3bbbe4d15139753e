# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Products that the rejector may have missed, kept until a person has looked for them."""

from enum import Enum, auto

_MAX_MISSED = 3  # products that are named
_MORE = 'and others'


class Latch(Enum):
    """State of a missed product, which keeps the line stopped until it is cleared."""

    CLEAR = auto()
    UNTOLD = auto()  # missed, and the stop request does not show it yet
    SHOWN = auto()  # missed, and the stop request shows it


class LatchEvent(Enum):
    """Events that change the latch."""

    MISS = auto()
    SHOW = auto()  # the stop request shows all missed products
    FORGET = auto()  # reject is not ready, or silent: it may have been started again
    RUN = auto()  # the stop request was taken back
    RESET = auto()


# If a stop request that showed a product is taken back, a person has looked for the product. A
# request that is taken back before it showed the product had another reason. All other pairs change
# nothing.
_TRANSITIONS = {
    (Latch.CLEAR, LatchEvent.MISS): Latch.UNTOLD,
    (Latch.UNTOLD, LatchEvent.SHOW): Latch.SHOWN,
    (Latch.UNTOLD, LatchEvent.RESET): Latch.CLEAR,
    (Latch.SHOWN, LatchEvent.MISS): Latch.UNTOLD,
    (Latch.SHOWN, LatchEvent.FORGET): Latch.UNTOLD,
    (Latch.SHOWN, LatchEvent.RUN): Latch.CLEAR,
    (Latch.SHOWN, LatchEvent.RESET): Latch.CLEAR,
}


class MissedProducts:
    """The latch, and the `texts` of the missed products.

    `looked_at` is the time in ns at which a person had last looked for all of them, else None.
    """

    def __init__(self) -> None:
        self.state = Latch.CLEAR
        self.looked_at: int | None = None
        self.texts: tuple[str, ...] = ()
        self._stopped = False  # last result of `stop`

    @property
    def text(self) -> str:
        """The texts in one line, empty if there are none."""
        return '; '.join(self.texts)

    def add(self, text: str) -> None:
        """Add the text of a product that may have been missed; only the first texts are kept."""
        if text in self.texts:
            return
        named = self.texts[:_MAX_MISSED]
        self.texts = (*named, text if len(named) < _MAX_MISSED else _MORE)
        self.take(LatchEvent.MISS)

    def take(self, event: LatchEvent) -> None:
        """Make the transition of an event."""
        self.state = _TRANSITIONS.get((self.state, event), self.state)
        if self.state is Latch.CLEAR:
            self.texts = ()

    def stop(self, now: int) -> bool:
        """Return whether the line has to stop for a missed product."""
        stopped, self._stopped = self._stopped, self.state is not Latch.CLEAR
        if stopped and not self._stopped:
            self.looked_at = now
        return self._stopped
