# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Entries of the audit log: each change with the value before it, across restarts.

The values that were last seen are found in the log itself. So a parameter file that was edited
while the line stood still is noticed at the next start.
"""

from collections.abc import Callable, Mapping

from checkweigher_dsp.production.audit_log import AuditLog, Entry, plain
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import Verdict

PARAMETER, FOUND, RECIPE, CALIBRATION = 'parameter', 'found', 'recipe', 'calibration'
SELECTION, REFUSED, BATCH, RESET = 'selection', 'refused', 'batch', 'reset'
RESTORED, ZERO = 'restored', 'zero'


class AuditTrail:
    """Changes, written to the log; a value that has not changed is not written.

    `source` is the node that writes; `clock` returns the time of an entry, ISO 8601, UTC. Without a
    log nothing is written. All methods raise `AuditError` if the log cannot be written.
    """

    def __init__(self, log: AuditLog | None, source: str, clock: Callable[[], str]) -> None:
        self._log = log
        self._source = source
        self._clock = clock
        self._parameters: dict[str, dict[str, object]] = {}
        self._last: dict[tuple[str, str], object] = {}
        self._zero_out_of_range = False
        for entry in log.entries if log else ():
            self._learn(entry)

    def _learn(self, entry: Entry) -> None:
        if entry.kind == FOUND:
            self._parameters.setdefault(entry.subject, {}).update(entry.new)
        elif entry.kind == PARAMETER:
            node, _, name = entry.subject.partition('.')
            self._parameters.setdefault(node, {})[name] = entry.new
        else:
            self._last[entry.kind, entry.subject] = entry.new

    def note(self, kind: str, subject: str, old: object, new: object) -> None:
        """Write down an action."""
        if self._log:
            entry = self._log.append(self._clock(), self._source, kind, subject, old, new)
            self._learn(entry)

    def state(self, kind: str, subject: str, value: object) -> None:
        """Write down a state if it is not the last one."""
        old = self._last.get((kind, subject))
        if old != plain(value):
            self.note(kind, subject, old, value)

    def found(self, node: str, values: Mapping[str, object]) -> None:
        """Write down the parameters of a node that differ from those that it had last."""
        known = self._parameters.get(node, {})
        new = {n: v for n, v in values.items() if n not in known or known[n] != plain(v)}
        if new:
            self.note(FOUND, node, {n: known[n] for n in new if n in known}, new)

    def parameter(self, node: str, name: str, value: object) -> None:
        """Write down that a parameter of a running node was set."""
        known = self._parameters.get(node, {})
        if name not in known or known[name] != plain(value):
            self.note(PARAMETER, f'{node}.{name}', known.get(name), value)

    def recipes(self, recipes: Mapping[str, Mapping[str, object]]) -> None:
        """Write down which recipes are new, changed or gone."""
        gone = {subject for kind, subject in self._last if kind == RECIPE} - set(recipes)
        for name, recipe in (*recipes.items(), *((name, None) for name in sorted(gone))):
            self.state(RECIPE, name, recipe)

    def verdict(self, verdict: Verdict) -> None:
        """Write down that the zero has left its range, or is back in it."""
        out = Reason.ZERO_OUT_OF_RANGE in verdict.reasons
        # Another fault says nothing of the zero.
        if out != self._zero_out_of_range and (out or not verdict.reasons):
            self._zero_out_of_range = out
            self.note(ZERO, Reason.ZERO_OUT_OF_RANGE.value, not out, out)
