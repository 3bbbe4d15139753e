# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Authors of changes: persons that the page announces, otherwise nodes."""

from collections.abc import Sequence
from typing import NamedTuple


class Author(NamedTuple):
    """Author of a change, a person or ``graph:`` and a node, and the reason that was given."""

    who: str = ''  # empty for the node that writes
    why: str = ''


class Authors:
    """Persons who are about to call services of the lane.

    The request of a service has no field for a name. The page therefore announces the person before
    the call and ends the announcement after it; entries of the service in between are the person's.
    An announcement ends after `patience` s at the latest. `now` is the time in s.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._callers: dict[str, tuple[Author, float]] = {}  # by service

    def announce(self, author: Author, services: Sequence[str], now: float) -> None:
        """Register the services that a person is about to call, in place of the earlier ones."""
        others = {n: known for n, known in self._callers.items() if known[0].who != author.who}
        self._callers = others | dict.fromkeys(services, (author, now + self._patience))

    def of(self, service: str, otherwise: str, now: float) -> Author:
        """Return the person who calls a service, or the node `otherwise`."""
        author, until = self._callers.get(service, (None, now))
        return Author(f'graph:{otherwise}') if author is None or until < now else author
