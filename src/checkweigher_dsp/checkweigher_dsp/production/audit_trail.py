"""What goes into the audit log: each change with the value before it, across restarts.

The values that were last seen are found in the log itself. So a parameter file that was edited
while the line stood still is noticed at the next start.
"""

from collections.abc import Iterable, Mapping

from checkweigher_dsp.production.audit_log import AuditLog, Entry, plain

PARAMETER, FOUND, RECIPE, CALIBRATION = 'parameter', 'found', 'recipe', 'calibration'
SELECTION, REFUSED, BATCH, RESET = 'selection', 'refused', 'batch', 'reset'
RESTORED, ZERO = 'restored', 'zero'


class AuditTrail:
    """Note down changes, and nothing that has not changed.

    Parameters
    ----------
    log : AuditLog or None
        Where to; None for nowhere.
    source : str
        Who notes it down.

    Notes
    -----
    All methods raise `AuditError` of `audit_log` if the log cannot be written.
    """

    def __init__(self, log: AuditLog | None, source: str) -> None:
        self._log = log
        self._source = source
        self._parameters: dict[str, dict[str, object]] = {}
        self._last: dict[tuple[str, str], object] = {}
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

    def note(self, time: str, kind: str, subject: str, old: object, new: object) -> None:
        """Note down something that was done."""
        if self._log:
            self._learn(self._log.append(time, self._source, kind, subject, old, new))

    def found(self, time: str, node: str, values: Mapping[str, object]) -> None:
        """Note down in what the parameters of a node differ from those that it had last."""
        known = self._parameters.get(node, {})
        new = {n: v for n, v in values.items() if n not in known or known[n] != plain(v)}
        if new:
            self.note(time, FOUND, node, {n: known[n] for n in new if n in known}, new)

    def parameter(self, time: str, node: str, name: str, value: object) -> None:
        """Note down that a parameter of a running node was set."""
        known = self._parameters.get(node, {})
        if name not in known or known[name] != plain(value):
            self.note(time, PARAMETER, f'{node}.{name}', known.get(name), value)

    def recipes(self, time: str, recipes: Mapping[str, Mapping[str, object]]) -> None:
        """Note down which recipes are new, changed or gone."""
        gone = self._known(RECIPE) - set(recipes)
        for name, recipe in (*recipes.items(), *((name, None) for name in sorted(gone))):
            self.state(time, RECIPE, name, recipe)

    def state(self, time: str, kind: str, subject: str, value: object) -> None:
        """Note down a state if it is not the last one."""
        old = self._last.get((kind, subject))
        if old != plain(value):
            self.note(time, kind, subject, old, value)

    def _known(self, kind: str) -> set[str]:
        pairs: Iterable[tuple[str, str]] = self._last
        return {subject for known, subject in pairs if known == kind}
