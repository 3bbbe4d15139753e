# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who makes a change, and why: persons as the page announces them, else the node."""

from collections.abc import Sequence
from typing import NamedTuple


class Author(NamedTuple):
    """Who makes a change, a person or ``graph:`` and a node, and the reason that was given."""

    who: str = ''  # empty for the node that writes
    why: str = ''


class Authors:
    """Persons who are about to call services of the lane, as the page announces them.

    A service has no room for a name. So the page says who calls it before it does, and takes that
    back afterwards: the entries of that service are the person's meanwhile. `now` is in s.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._callers: dict[str, tuple[Author, float]] = {}  # by service

    def announce(self, author: Author, services: Sequence[str], now: float) -> None:
        """Take who is about to call some services; none for who calls no more."""
        for name in [name for name, (known, _) in self._callers.items() if known.who == author.who]:
            del self._callers[name]
        for name in services:
            self._callers[name] = author, now + self._patience

    def of(self, service: str, otherwise: str, now: float) -> Author:
        """Return who calls a service, or `otherwise` where nobody has said so."""
        author, until = self._callers.get(service, (None, now))
        if author is None or until < now:
            return Author(f'graph:{otherwise}')
        return author
