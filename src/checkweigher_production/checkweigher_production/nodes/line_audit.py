# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The audit log of a lane: what its nodes are about to change, and what was found changed."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
import json
import time
from typing import Any

from checkweigher_core import changes
from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.printable import one_line
from checkweigher_core.records import LoadCell, ZeroChange
from checkweigher_core.ros import ports
from checkweigher_core.ros.line_parameters import LineParametersClient, Values
from checkweigher_core.ros.services import SETTER
from checkweigher_production.audit_log import MAX_LOG, AuditError, AuditLog
from checkweigher_production.audit_trail import AuditTrail
from checkweigher_production.authors import Author, Authors
from checkweigher_production.nodes.parameter_audit import ParameterAudit

_LONGEST_NAME = 64  # characters, of a person
_CALL_PATIENCE = 150.0  # s, in which a person's call has ended
# Node that makes a change and the service that asks it to, by kind and subject of the entry.
_OF_SERVICES = {
    changes.ZERO: ('segmenter', ports.ZERO),
    changes.LEARNED: ('identifier', ports.FORGET_LEARNED),
    changes.TUNED: (ports.DYNAMIC_SETTING.name, ports.ACCEPT_TUNED),
    changes.CALIBRATION: ('driver', ports.FINISH_CALIBRATION),
}


class LineAudit:
    """Write into the audit log what changes on a lane, with who changes it and why.

    `log` is None on a lane without one; `node` is the full name of the node that writes, `line` its
    client of the parameters. `has_record` tells whether a batch has a record, `warn` takes a
    warning for the log of the node.
    """

    def __init__(
        self, log: AuditLog | None, node: str, clock: Callable[[], str],
        line: LineParametersClient, has_record: Callable[[str], bool],
        warn: Callable[[str], object],
    ) -> None:  # fmt: skip
        self._log = log
        self._namespace = node.rpartition('/')[0]
        self._has_record = has_record
        self._warn = warn
        self._authors = Authors(_CALL_PATIENCE)
        self.trail = AuditTrail(log, node, clock)
        self.parameters = ParameterAudit(self._namespace, line, self.trail, warn)

    def awaits(self, nodes: set[str]) -> bool:
        """Tell whether the log has to have parameters of some nodes before they are changed."""
        return self._log is not None and not self.parameters.unread.isdisjoint(nodes)

    def announce(self, changes: dict[str, Values], by: Author) -> None:
        """Write down what parameters of some nodes are about to become."""
        if self._log is not None:
            self.parameters.announce(changes, by)

    def author_of(self, service: str, node: str = 'product') -> Author:
        """Return who calls a service of a node: a person, or else the node."""
        return self._authors.of(service, f'{self._namespace}/{node}', time.monotonic())

    def on_change(self, request: Any, response: Any) -> Any:
        """Write down what a node of the line is about to change."""
        try:
            self._write(request, json.loads(request.new_value))
            response.success = True
        except (AuditError, ValueError, RecursionError) as error:
            response.message = str(error)
            self._warn(f'{request.subject}: {request.kind}: not written down, so refused: {error}')
        return response

    def _write(self, request: Any, value: Any) -> None:
        kind, subject = request.kind, request.subject
        namespace, _, node = subject.rpartition('/')
        here = namespace == self._namespace
        if kind == changes.PERSON and len(subject) <= _LONGEST_NAME:
            self._hear_person(one_line(subject), request, value)
        elif kind == changes.PARAMETER and here and isinstance(value, dict):
            self.parameters.announce({node: value}, self.author_of(f'{node}/{SETTER}', node))
        elif kind == changes.REPORT and self._has_record(subject):
            by = Author(f'graph:{self._namespace}/batch_reporter')
            self.trail.state(kind, subject, value, by)
        elif subject == self._subjects().get(kind):
            maker, service = _OF_SERVICES[kind]
            by = self.author_of(service, maker)
            if kind == changes.CALIBRATION:
                self.trail.state(kind, subject, value, by)
            else:
                self.trail.note(kind, subject, None, value, by)
        else:
            raise AuditError(f'{kind} of {subject}: is nothing that is changed on this lane')

    def _subjects(self) -> dict[str, str]:
        """Return the subject of each kind of entry of `_OF_SERVICES`."""
        return {
            changes.ZERO: ports.ZERO,
            changes.LEARNED: f'{self._namespace}/identifier',
            changes.TUNED: f'{self._namespace}/{ports.DYNAMIC_SETTING.name}',
            changes.CALIBRATION: ports.LOAD_CELL_INFO.name,
        }

    def _hear_person(self, name: str, request: Any, value: Any) -> None:
        """Take which services a person is about to call, or write down what a person did."""
        author = Author(name, one_line(request.reason))
        if value is None:
            self._authors.announce(author, list(request.subjects), time.monotonic())
        elif isinstance(value, str):
            self.trail.note(changes.PERSON, name, None, one_line(value), author)
        else:
            raise AuditError(f'{name}: what a person did is a text')

    async def read_started(self) -> None:
        """Write what is owed, and compare the parameters of nodes that were started."""
        with suppress(AuditError):  # the diagnostics tell
            self.trail.catch_up()
        await self.parameters.read_started()

    def on_load_cell(self, load_cell: LoadCell) -> None:
        """Write down a calibration that is not the last one known."""
        by = Author(f'graph:{self._namespace}/driver')
        name = ports.LOAD_CELL_INFO.name
        self.trail.saw_state(changes.CALIBRATION, name, asdict(load_cell), by)

    def on_zero_setting(self, change: ZeroChange) -> None:
        """Write down the zero that was set."""
        by = self.author_of(ports.ZERO, 'segmenter')
        self.trail.saw_state(changes.ZERO, ports.ZERO_SETTING.name, asdict(change), by)

    def finding(self) -> Finding:
        """Return the aspect Audit log of the diagnostics."""
        if self._log is None:
            return conclude('Audit log', 'none: changes are not written down', ())
        values: dict[str, float | str] = {
            'path': str(self._log.path), 'last_hash': self._log.last_hash,
            'nodes_to_be_read': len(self.parameters.unread),
        }  # fmt: skip
        found = []
        if trouble := self._log.trouble():
            hint = 'changes are refused: restore log and LOG.head, and start product again'
            found.append(Concern(Level.ERROR, trouble, hint))
        elif self.trail.trouble:
            hint = 'changes are refused: make room, or see to the disk'
            found.append(Concern(Level.ERROR, self.trail.trouble, hint))
        if self._log.size > 0.9 * MAX_LOG:
            text = f'{self._log.path} has {self._log.size} bytes of {MAX_LOG} at most'
            found.append(Concern(Level.WARN, text, 'name another file in audit_log'))
        return conclude('Audit log', f'written to {self._log.path}', found, values)
