# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Entries of the audit log: each change with the value before it, across restarts.

The values that were last seen are found in the log itself. So a parameter file that was edited
while the line stood still is noticed at the next start.
"""

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from checkweigher_core.changes import FOUND, PARAMETER, RECIPE, REFUSED, ZERO, plain
from checkweigher_core.records import Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_production.audit_log import AuditError, AuditLog
from checkweigher_production.authors import Author


class AuditTrail:
    """Changes, written to the log; a value that has not changed is not written.

    `source` is the node that writes; `clock` returns the time of an entry, ISO 8601, UTC. Without a
    log nothing is written.

    What is about to be done is written by a method that raises `AuditError` if it cannot be: then
    it must not be done. What has been done already (`saw` and `saw_state`) is written as soon as
    that is possible, with the time at which it was done. `trouble` is why the log cannot be written
    at present, empty if it can.
    """

    def __init__(self, log: AuditLog | None, source: str, clock: Callable[[], str]) -> None:
        self._log = log
        self._source = source
        self._clock = clock
        self._parameters: dict[str, dict[str, object]] = {}
        self._last: dict[tuple[str, str], object] = {}
        self._zero_out_of_range = False
        self._owed: deque[tuple[str, str, str, object, object, Author | None]] = deque(maxlen=1_000)
        self._refused, self._reason = 0, ''  # changes since the last entry, and why the last
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
        """Write down an action that is about to be done."""
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
        """Write down something that has been done."""
        if not self._log:
            return
        self._learn(kind, subject, plain(new))
        self._owed.append((self._clock(), kind, subject, old, new, by))
        with suppress(AuditError):
            self.catch_up()

    def catch_up(self) -> None:
        """Write down what could not be written when it was done, and how much was refused."""
        while self._owed:
            self._append(*self._owed[0])
            self._owed.popleft()
        if self._refused:
            text = f'{self._refused} changes, for the log could not be written: {self._reason}'
            self._append(self._clock(), REFUSED, 'audit log', None, text, None)
            self._refused = 0

    def _append(
        self,
        time: str,
        kind: str,
        subject: str,
        old: object,
        new: object,
        by: Author | None,
    ) -> None:
        assert self._log is not None
        try:
            self._log.append(time, self._source, kind, subject, old, new, *(by or Author()))
        except AuditError as error:
            self.trouble = str(error)
            raise
        self.trouble = ''

    def last(self, kind: str, subject: str) -> Any:
        """Return the last value of a subject, None if it has none."""
        return self._last.get((kind, subject))

    def state(self, kind: str, subject: str, value: object, by: Author | None = None) -> None:
        """Write down a state that is about to be, if it is not the last one."""
        old = self._last.get((kind, subject))
        if old != plain(value):
            self.note(kind, subject, old, value, by)

    def saw_state(self, kind: str, subject: str, value: object, by: Author | None = None) -> None:
        """Write down a state that is, if it is not the last one."""
        old = self._last.get((kind, subject))
        if old != plain(value):
            self.saw(kind, subject, old, value, by)

    def found(self, node: str, values: Mapping[str, object]) -> None:
        """Write down the parameters of a node that differ from those that it had last."""
        known = self._parameters.get(node, {})
        new = {n: v for n, v in values.items() if n not in known or known[n] != plain(v)}
        if new:
            self.note(FOUND, node, {n: known[n] for n in new if n in known}, new)

    def parameters(self, node: str, values: Mapping[str, object], by: Author | None = None) -> None:
        """Write down that parameters of a running node are about to be set."""
        for name, value in values.items():
            known = self._parameters.get(node, {})
            if name not in known or known[name] != plain(value):
                self.note(PARAMETER, f'{node}.{name}', known.get(name), value, by)

    def recipes(
        self, recipes: Mapping[str, Mapping[str, object]], by: Author | None = None
    ) -> None:
        """Write down which recipes are new, changed or gone."""
        gone = {subject for kind, subject in self._last if kind == RECIPE} - set(recipes)
        for name, recipe in (*recipes.items(), *((name, None) for name in sorted(gone))):
            self.state(RECIPE, name, recipe, by)

    def verdict(self, verdict: Verdict) -> None:
        """Write down that the zero has left its range, or is back in it."""
        out = Reason.ZERO_OUT_OF_RANGE in verdict.reasons
        # Another fault says nothing of the zero.
        if out != self._zero_out_of_range and (out or not verdict.reasons):
            self._zero_out_of_range = out
            self.saw(ZERO, Reason.ZERO_OUT_OF_RANGE.value, not out, out)
