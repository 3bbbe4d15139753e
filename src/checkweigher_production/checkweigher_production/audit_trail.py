# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Writer of changes to the audit log, with the author and the previous value of each change.

The previous values are read from the log. Therefore, a change of a parameter file while the line
was not running is detected at the next start.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType
from typing import Any, NamedTuple

from checkweigher_core.changes import FOUND, PARAMETER, RECIPE, REFUSED, ZERO, plain
from checkweigher_core.records import Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_production.audit_log import AuditError, AuditLog

CLAIMED = 'claimed:'  # prefix of a person's name that was not verified, for example by a password


class Author(NamedTuple):
    """Author of a change, and the reason that the author has given."""

    # Name of a person, CLAIMED followed by a name, or ``graph:`` followed by the name of a node.
    # The name is empty for the node that writes the log.
    who: str = ''
    why: str = ''


class Authors:
    """Persons who are about to call services of the line.

    A service request has no field for the name of a person. Therefore the page or a gateway
    announces the person before a call, and withdraws the announcement after it. The audit log names
    this person as the author of all changes that the service makes in between. An announcement
    expires after `patience` s. In all methods, `now` is the time in s.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        # Person and expiry time of the announcement in s, by service.
        self._callers: dict[str, tuple[Author, float]] = {}

    def announce(self, author: Author, services: Sequence[str], now: float) -> None:
        """Set the services that a person is about to call.

        `services` replace the services that were announced before for this person. An empty
        sequence withdraws the announcement. If a service in `services` was announced for another
        person, the new announcement replaces the earlier one.
        """
        others = {n: known for n, known in self._callers.items() if known[0].who != author.who}
        self._callers = others | dict.fromkeys(services, (author, now + self._patience))

    def of(self, service: str, otherwise: str, now: float) -> Author:
        """Return the person announced as the caller of a service.

        Without an announcement, or after it has expired, the node `otherwise` is returned.
        """
        author, until = self._callers.get(service, (None, now))
        return Author(f'graph:{otherwise}') if author is None or until < now else author


class AuditTrail:
    """Writer of changes to the audit log.

    A state or recipe is written only if it differs from the last one in the log. `source` is the
    name of this node, and `clock` returns the time of an entry (ISO 8601, UTC). If `log` is None,
    the methods do not write anything.

    `note`, `state`, `parameters` and `recipes` must be called before a change is made. If one of
    these methods raises `AuditError`, the change must not be made. `saw` and `saw_state` are for
    changes that have happened. If the log cannot be written at present, the entries of these
    changes are written later. At most 1,000 entries wait; if there are more, the oldest are lost.
    `trouble` is the reason why the last entry could not be written, or empty if it was written.
    """

    def __init__(self, log: AuditLog | None, source: str, clock: Callable[[], str]) -> None:
        self._log = log
        self._source = source
        self._clock = clock
        self._parameters: dict[str, dict[str, object]] = {}
        self._last: dict[tuple[str, str], object] = {}
        self._zero_out_of_range = False
        # Arguments of `_append` for the entries that could not be written yet.
        self._owed: deque[tuple[str, str, str, object, object, Author | None]] = deque(maxlen=1_000)
        # Number of changes that were refused because of a fault of the log, and the last fault.
        self._refused, self._reason = 0, ''
        self.trouble = ''
        for entry in log.entries if log else ():
            self._learn(entry.kind, entry.subject, entry.new)

    def _learn(self, kind: str, subject: str, new: Any) -> None:
        node, _, name = subject.partition('.')
        if kind in (FOUND, PARAMETER):
            self._parameters.setdefault(node, {}).update({name: new} if name else new)
        else:
            self._last[kind, subject] = new

    def note(
        self, kind: str, subject: str, old: object, new: object, by: Author | None = None
    ) -> None:
        """Write the entry of a change that is about to be made.

        Entries that wait to be written are written before it. Raises `AuditError` if an entry
        cannot be written; the caller must then not make the change.
        """
        if not self._log:
            return
        try:
            self.catch_up()
            self._append(self._clock(), kind, subject, old, new, by)
        except AuditError as error:
            self._refused, self._reason = self._refused + 1, str(error)
            raise
        self._learn(kind, subject, plain(new))

    def saw(
        self, kind: str, subject: str, old: object, new: object, by: Author | None = None
    ) -> None:
        """Write the entry of a change that has happened, as soon as the log can be written."""
        if not self._log:
            return
        self._learn(kind, subject, plain(new))
        self._owed.append((self._clock(), kind, subject, old, new, by))
        with suppress(AuditError):
            self.catch_up()

    def catch_up(self) -> None:
        """Write the entries that could not be written before, and the number of refused changes.

        Raises `AuditError` if the log still cannot be written.
        """
        while self._owed:
            self._append(*self._owed[0])
            self._owed.popleft()
        if self._refused:
            changes = 'change' if self._refused == 1 else 'changes'
            text = (
                f'{self._refused} {changes}, because the log could not be written: {self._reason}'
            )
            self._append(self._clock(), REFUSED, 'audit log', None, text, None)
            self._refused = 0

    def _append(
        self, time: str, kind: str, subject: str, old: object, new: object, by: Author | None
    ) -> None:
        assert self._log is not None
        try:
            self._log.append(time, self._source, kind, subject, old, new, *(by or Author()))
        except AuditError as error:
            self.trouble = str(error)
            raise
        self.trouble = ''

    def last(self, kind: str, subject: str) -> Any:
        """Return the last value of a subject, or None if no entry states a value.

        An entry of `saw` counts even if it waits to be written.
        """
        return self._last.get((kind, subject))

    def known(self, kind: str) -> dict[str, Any]:
        """Return the last value of each subject with entries of a kind.

        The subjects are in the order of their first entries.
        """
        return {subject: value for (each, subject), value in self._last.items() if each == kind}

    def state(self, kind: str, subject: str, value: object, by: Author | None = None) -> None:
        """Write a state that is about to be set, unless it equals the last state in the log.

        Raises `AuditError` if the entry cannot be written.
        """
        if (old := self.last(kind, subject)) != plain(value):
            self.note(kind, subject, old, value, by)

    def saw_state(self, kind: str, subject: str, value: object, by: Author | None = None) -> None:
        """Write a state that has been set, unless it equals the last state in the log."""
        if (old := self.last(kind, subject)) != plain(value):
            self.saw(kind, subject, old, value, by)

    def found(self, node: str, values: Mapping[str, object]) -> None:
        """Write the parameters of a started node that differ from the last values in the log.

        Raises `AuditError` if the log cannot be written.
        """
        if new := self._changed(node, values):
            known = self._parameters.get(node, {})
            self.note(FOUND, node, {n: known[n] for n in new if n in known}, new)

    def parameters(
        self,
        node: str,
        values: Mapping[str, object],
        by: Author | None = None,
        in_use: Mapping[str, object] = MappingProxyType({}),
    ) -> None:
        """Write one entry for each parameter of a running node that is about to be set.

        `in_use` contains the old values that differ from the parameters, for example the limits of
        a product. Raises `AuditError` if an entry cannot be written.
        """
        known = {**self._parameters.get(node, {}), **in_use}
        for name, value in values.items():
            old = known.get(name)
            self.note(PARAMETER, f'{node}.{name}', old, value, by)

    def _changed(self, node: str, values: Mapping[str, object]) -> dict[str, object]:
        known = self._parameters.get(node, {})
        return {n: v for n, v in values.items() if n not in known or known[n] != plain(v)}

    def recipes(
        self, recipes: Mapping[str, Mapping[str, object]], by: Author | None = None
    ) -> None:
        """Write one entry for each recipe that is new, changed or removed.

        `recipes` are all recipes that are about to be used. The new value of a removed recipe is
        None. Raises `AuditError` if an entry cannot be written.
        """
        gone = self.known(RECIPE).keys() - recipes.keys()
        for name, recipe in (*recipes.items(), *((name, None) for name in sorted(gone))):
            self.state(RECIPE, name, recipe, by)

    def verdict(self, verdict: Verdict) -> None:
        """Write an entry if the fault ZeroOutOfRange begins or ends with a verdict."""
        out = Reason.ZERO_OUT_OF_RANGE in verdict.reasons
        # A verdict with other reasons does not end the fault, because an item may get them before
        # its zero is checked.
        if out != self._zero_out_of_range and (out or not verdict.reasons):
            self._zero_out_of_range = out
            self.saw(ZERO, Reason.ZERO_OUT_OF_RANGE.value, not out, out)
