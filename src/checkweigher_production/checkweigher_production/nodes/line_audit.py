# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Audit log of a line: requested changes of its nodes, and parameters read from its nodes."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
import json
import math
import time
from typing import Any

from checkweigher_core import changes
from checkweigher_core.health.findings import Finding, conclude, error_if, warn_if
from checkweigher_core.health.host_clock import ClockSteps
from checkweigher_core.printable import one_line
from checkweigher_core.records import LoadCell, ZeroChange
from checkweigher_core.ros import ports
from checkweigher_core.ros.change_record import TIME_TO_CHANGE
from checkweigher_core.ros.line_parameters import LineParametersClient, RefusedError, Values
from checkweigher_core.ros.services import REPORTER, SETTER, SETTING
from checkweigher_dsp.legal import legal_software
from checkweigher_production.audit_log import MAX_LOG, AuditError, AuditLog
from checkweigher_production.audit_trail import CLAIMED, AuditTrail, Author, Authors
from checkweigher_production.batch_record import RecordState, has_ended

_LONGEST_NAME = 64  # largest number of characters in the name of a person
_CALL_PATIENCE = 150.0  # time in s after which the announcement of a service call expires


class LineAudit:
    """Writer of the audit log of a line.

    The parameters of a node are written when the node starts. A change of a parameter is written
    before it is made. The parameters are read again later, so that the log is right even if the
    change was not made.

    If `log` is None, nothing is written. `node` is the full name of this node, `clock` returns the
    time of an entry (ISO 8601, UTC), and `line` is the client for the parameters of all nodes.
    `has_record` returns whether a batch has a record, and `warn` logs a warning. `limits` returns
    the limits that the reject node uses, which may be those of a product.
    """

    def __init__(
        self,
        log: AuditLog | None,
        node: str,
        clock: Callable[[], str],
        line: LineParametersClient,
        has_record: Callable[[str], bool],
        warn: Callable[[str], object],
        limits: Callable[[], Values],
    ) -> None:
        self._log = log
        self._limits = limits
        self._namespace = node.rpartition('/')[0]
        self._line = line
        self._has_record = has_record
        self._warn = warn
        self._authors = Authors(_CALL_PATIENCE)
        self._steps = ClockSteps()
        self._unread = set(ports.NODES)  # nodes whose parameters have not been read yet
        self._announced: dict[str, float] = {}  # time of the last announced change in s, by node
        self.trail = AuditTrail(log, node, clock)
        known = self.trail.last(changes.SOFTWARE, 'line')
        self.trail.saw(changes.SOFTWARE, 'line', known, legal_software().value)
        last = log.entries[-1].time if log is not None and log.entries else ''
        if last > (now := clock()):
            # The last entry has a later time than now, so record that the clock was set back.
            self.trail.saw(changes.CLOCK, 'start', last, now)
        # Subject, node and service of each kind of change that a node makes on request.
        self._asked = {
            changes.ZERO: (ports.ZERO, 'segmenter', ports.ZERO),
            changes.LEARNED: (f'{self._namespace}/identifier', 'identifier', ports.FORGET_LEARNED),
            changes.TUNED: (f'{self._namespace}/{SETTING}', SETTING, ports.ACCEPT_TUNED),
            changes.CALIBRATION: (ports.LOAD_CELL_INFO.name, 'driver', ports.FINISH_CALIBRATION),
        }

    def awaits(self, nodes: set[str]) -> bool:
        """Return whether parameters of one of `nodes` must still be read and written to the log.

        While the result is True, no parameter of `nodes` may be set. Without a log, the result is
        False.
        """
        return self._log is not None and not self._unread.isdisjoint(nodes)

    def add_started(self, nodes: set[str]) -> None:
        """Register started nodes, whose parameters must be read.

        Names that are not in `NODES` are ignored.
        """
        self._unread |= nodes.intersection(ports.NODES)

    def announce(self, changes: Mapping[str, Values], by: Author) -> None:
        """Write the parameters that are about to be set to the audit log.

        `changes` contains the new values by node and parameter name. Raises `AuditError` if a node
        does not belong to the line or the log cannot be written; the caller must then not set the
        parameters.
        """
        for node, values in changes.items():
            if node not in ports.NODES:
                raise AuditError(f'{node}: is not a node of the line')
            self._announced[node] = time.monotonic()
            in_use = self._limits() if node == 'reject' else {}
            self.trail.parameters(f'{self._namespace}/{node}', values, by, in_use)

    def author_of(self, service: str, node: str = 'product') -> Author:
        """Return the person announced as the caller of a service, otherwise the node `node`."""
        return self._authors.of(service, f'{self._namespace}/{node}', time.monotonic())

    def on_change(self, request: Any, response: Any) -> str:
        """Write the change that another node, a command or the page is about to make.

        This is the callback of the service `RECORD_CHANGE`. Returns an empty message. Raises
        ValueError if the change cannot be written or is not possible on this line; the caller of
        the service must then not make the change.
        """
        try:
            self._write(request, json.loads(request.new_value))
        except (ValueError, RecursionError) as error:
            self._warn(f'{request.subject}: {request.kind}: not written down, so refused: {error}')
            raise ValueError(str(error)) from None
        return ''

    def _write(self, request: Any, value: Any) -> None:
        kind, subject = request.kind, request.subject
        namespace, _, node = subject.rpartition('/')
        if kind == changes.PERSON and len(subject) <= _LONGEST_NAME:
            self._write_person(one_line(subject), request, value)
        elif (kind, namespace) == (changes.PARAMETER, self._namespace) and isinstance(value, dict):
            self.announce({node: value}, self.author_of(f'{node}/{SETTER}', node))
        elif kind == changes.REPORT and self._has_record(subject):
            self.trail.state(kind, subject, value, Author(f'graph:{self._namespace}/{REPORTER}'))
        elif self._may_request(kind, subject, value):
            by = self.claimed_by(ports.RECORD_CHANGE, request.who, request.reason)
            self.trail.note(kind, subject, None, value, by)
        else:
            self._write_asked(kind, subject, value)

    def _may_request(self, kind: str, subject: str, value: Any) -> bool:
        """Return whether a command or the page may request an entry with this kind and subject.

        If a batch is signed, the subject must be a batch with a record. Otherwise, the kind must be
        a signature, a verification or a tare, and the subject at most `_LONGEST_NAME` characters
        long.
        """
        if kind == changes.SIGNATURE and isinstance(value, dict) and 'batch' in value:
            return self._has_record(subject)
        own = changes.SIGNATURE, changes.VERIFICATION, changes.TARE
        return kind in own and len(subject) <= _LONGEST_NAME

    def _write_asked(self, kind: str, subject: str, value: Any) -> None:
        known, maker, service = self._asked.get(kind, (None, '', ''))
        if subject != known:
            raise AuditError(f'{kind} of {subject}: cannot be changed on this line')
        by = self.author_of(service, maker)
        if kind == changes.CALIBRATION:
            self.trail.state(kind, subject, value, by)
        else:
            self.trail.note(kind, subject, None, value, by)

    def _write_person(self, name: str, request: Any, value: Any) -> None:
        """Register the services that a person is about to call, or write the action of a person.

        `value` is None for an announcement of services, or a text that states the action. Raises
        `AuditError` if `value` is of another type, or if the action cannot be written.
        """
        author = Author(name, one_line(request.reason))
        if value is None:
            self._authors.announce(author, list(request.subjects), time.monotonic())
        elif isinstance(value, str):
            self.trail.note(changes.PERSON, name, None, one_line(value), author)
        else:
            raise AuditError(f'{name}: the action of a person must be a text')

    async def read_started(self) -> None:
        """Write pending entries, and the parameters of started and changed nodes.

        A node that does not answer is read at the next call.
        """
        with suppress(AuditError):  # ignored here, because the diagnostics show this fault
            self.trail.catch_up()
        for node in ports.NODES:
            began = time.monotonic()
            changed = began - self._announced.get(node, math.inf) > TIME_TO_CHANGE
            if not (changed or node in self._unread) or not self._line.ready(node):
                continue
            try:
                values = await self._line.get_all(node)
                # Values that were read while a change was announced are ignored and read again
                # later, because they may be from before the change.
                if self._announced.get(node, -math.inf) < began:
                    self.trail.found(f'{self._namespace}/{node}', values)
                    self._unread.discard(node)
                    if changed:
                        del self._announced[node]
            except (AuditError, RefusedError) as error:
                self._warn(str(error))

    def on_load_cell(self, load_cell: LoadCell) -> None:
        """Write the calibration if it differs from the last calibration in the log."""
        by = Author(f'graph:{self._namespace}/driver')
        self.trail.saw_state(changes.CALIBRATION, ports.LOAD_CELL_INFO.name, asdict(load_cell), by)

    def on_zero_setting(self, change: ZeroChange) -> None:
        """Write a zero that was set by the service, unless it is the last zero in the log."""
        by = self.author_of(ports.ZERO, 'segmenter')
        self.trail.saw_state(changes.ZERO, ports.ZERO_SETTING.name, asdict(change), by)

    def watch_clock(self, reference: str) -> None:
        """Write a step of the clock since the last call, and a change of its reference.

        `reference` is a text on the time reference of the clock, empty if it is not known yet.
        """
        if step := self._steps.step():
            self.trail.saw(changes.CLOCK, 'step', None, {'seconds': round(step, 3)})
        if reference:
            self.trail.saw_state(changes.CLOCK, 'reference', reference)

    def claimed_by(self, service: str, who: str, why: str) -> Author:
        """Return the person who calls a service.

        A person whom the page or a gateway has announced is trusted. Without an announcement, the
        result has the reason `why` and the name ``claimed:`` followed by `who`, because the name in
        a request is only a claim. If `who` is empty, the name is empty.
        """
        announced = self._authors.of(service, '', time.monotonic())
        if not announced.who.startswith('graph:'):
            return announced
        return Author(f'{CLAIMED}{name}' if (name := one_line(who)) else '', one_line(why))

    def write_state(self, state: RecordState) -> None:
        """Write the state of a batch record.

        If the record has ended according to the log, the state is written only if the record is
        broken.
        """
        last = self.trail.last(changes.RECORD, state.batch)
        if state.broken or not has_ended(last):
            self.trail.saw_state(changes.RECORD, state.batch, state.value)

    def finding(self) -> Finding:
        """Return the diagnostics finding "Audit log", an error if changes cannot be written."""
        if self._log is None:
            return conclude('Audit log', 'none: changes are not written down', ())
        values: dict[str, float | str] = {
            'path': str(self._log.path),
            'last_hash': self._log.last_hash,
            'nodes_to_be_read': len(self._unread),
            'legal_software_sha256': legal_software().sha256,
        }
        altered, trouble = self._log.trouble(), self.trail.trouble
        restore = 'changes are refused: restore log and LOG.head, and start product again'
        large = f'{self._log.path} has {self._log.size} bytes of {MAX_LOG} at most'
        concerns = (
            error_if(bool(altered), altered, restore),
            error_if(bool(trouble), trouble, 'changes are refused: make room, or see to the disk'),
            warn_if(self._log.size > 0.9 * MAX_LOG, large, 'name another file in audit_log'),
        )
        return conclude('Audit log', f'written to {self._log.path}', concerns, values)
