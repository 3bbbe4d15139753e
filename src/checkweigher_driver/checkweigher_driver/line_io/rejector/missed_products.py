# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Products that may have been missed, which stop the line until a person has looked for them."""

_MAX_MISSED = 3  # largest number of products whose messages are kept
_MORE = 'and others'


class MissedProducts:
    """Messages on missed products, which stop the line until they are cleared.

    `texts` contains up to three messages, and "and others" if there are more. `shown` is true if
    the stop request shows all messages. A person who resets a stop request with all messages has
    looked for the products. `looked_at` is the time in ns on the monotonic clock at which messages
    were last cleared, or None before the first time.
    """

    def __init__(self) -> None:
        self.texts: tuple[str, ...] = ()
        self.shown = False
        self.looked_at: int | None = None
        self._stopped = False  # previous result of `stop`

    @property
    def text(self) -> str:
        """Messages on the missed products in one line, empty if no product is missed."""
        return '; '.join(self.texts)

    @property
    def pending(self) -> bool:
        """Whether there are messages that the stop request does not show yet."""
        return bool(self.texts) and not self.shown

    def add(self, text: str) -> None:
        """Add the message on a product that may have been missed, unless `texts` contains it.

        From the fourth message on, "and others" is added instead.
        """
        if text not in self.texts:
            named = self.texts[:_MAX_MISSED]
            self.texts = (*named, text if len(named) < _MAX_MISSED else _MORE)
            self.shown = False

    def clear(self) -> None:
        """Remove the messages, because a person has looked for the products."""
        self.texts = ()

    def stop(self, now: int) -> bool:
        """Return whether the line has to stop because of a missed product.

        The first call after `clear` has removed messages sets `looked_at` to `now`.
        """
        stopped, self._stopped = self._stopped, bool(self.texts)
        if stopped and not self._stopped:
            self.looked_at = now
        return self._stopped
