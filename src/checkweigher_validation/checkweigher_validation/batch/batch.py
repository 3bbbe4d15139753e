# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batch of items, from weighed items, a batch record, or a CSV file of the command `weigh`."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
import csv
from dataclasses import dataclass, replace
from enum import StrEnum
import hashlib
import io
from itertools import islice
import math
from pathlib import Path
from typing import Any

from checkweigher_core.changes import ALARM, RECORD
from checkweigher_core.printable import one_line
from checkweigher_core.records import GRAMS, Alarm, Decision, FillerFeedback, Verdict
from checkweigher_production.alarms import alarm_of
from checkweigher_production.audit_chain import LOG_FILE, LogChain, read_chain
from checkweigher_production.audit_log import FIRST_PREVIOUS, Entry
from checkweigher_production.audit_words import software_in
from checkweigher_production.batch_record import (
    ENDED,
    RecordError,
    RecordState,
    fault_of,
    has_ended,
    read_events,
    record_path,
    states_in,
)
from checkweigher_production.recipes import Product
from checkweigher_validation.accuracy.results import ItemResult
from checkweigher_validation.batch.counts import count_faults
from checkweigher_validation.batch.signatures import Signature, signature_faults, signatures_in

_UNKNOWN = 'the audit log does not know this batch'
_NO_LOG = 'there is no audit log to compare the record with; give it with --log'
_MOST_FAULTS = 3  # largest number of reported faults in the counts of a record


class BatchError(ValueError):
    """Raised if a CSV file is not a valid batch.

    The message contains the file, the fault and, if a row is at fault, the number of its line.
    """


class InLog(StrEnum):
    """Result of the comparison of a batch record with the states of the record in the audit log."""

    AGREES = 'agrees'
    DIFFERS = 'differs'
    ABSENT = 'not in the log'


@dataclass(frozen=True, slots=True)
class BatchItem:
    """Item of a batch. Raises `ValueError` if the item was accepted without a mass."""

    decision: Decision
    reasons: tuple[str, ...]
    mass: float  # mass of the contents in kg, NaN if the item was not weighed
    stamp: int | None = None  # time of the item in ns, None if unknown

    def __post_init__(self) -> None:
        # Refuse an accepted item without a mass, because the batch rules and the reference test
        # need the masses of all accepted items.
        if self.decision is Decision.ACCEPT and not math.isfinite(self.mass):
            raise ValueError('the decision is ACCEPT, but the item has no mass')


@dataclass(frozen=True, slots=True)
class Part:
    """Items of one product in a batch, in the order of their verdicts."""

    product: Product
    items: tuple[BatchItem, ...]


@dataclass(frozen=True, slots=True)
class Batch:
    """Items and events of a batch. An unknown text is empty."""

    name: str
    source: str  # name of the file or the bag
    parts: tuple[Part, ...]
    sha256: str = ''  # SHA-256 digest of the file
    begin: str = ''  # time of the beginning, ISO 8601
    end: str = ''  # time of the end, ISO 8601, or empty if the batch has not ended
    stops: tuple[dict[str, Any], ...] = ()  # stop requests in the record
    corrections: tuple[FillerFeedback, ...] = ()  # feedback to the filler in the record
    changes: tuple[Entry, ...] = ()  # entries of the audit log during the batch except alarms
    alarms: tuple[Alarm, ...] = ()  # last state of each alarm that changed during the batch
    in_log: InLog | None = None  # None without an audit log
    log: str = ''  # name of the audit log, with number and hash of its last entry
    faults: tuple[str, ...] = ()  # reasons why the record cannot be trusted
    strays: int = 0  # number of items in the record that belong to another batch
    software: str = ''  # SHA-256 of the legally relevant software at the last start
    signatures: tuple[Signature, ...] = ()
    after: str = ''  # hash of the last entry of the audit log before the batch

    @property
    def persons(self) -> int:
        """Number of persons who must have signed when the batch is released.

        The number is the largest `release_by` of the recipes, or 1 if the batch has no items.
        """
        return max((part.product.release_by for part in self.parts), default=1)

    def with_log(self, logs: LogChain, data: bytes) -> 'Batch':
        """Return the batch with its changes, alarms and signatures in the audit logs.

        The fields `in_log`, `log` and `software` are also set. The following are added to `faults`:
        a fault of the log, the absence of the batch from the log, a contradiction between log and
        record, and each void signature. `data` is the content of the record.
        """
        states = states_in(logs.entries, self.name)
        fault = self._fault_by(states, data)
        signatures = signatures_in(logs.entries, self.name)
        faults = filter(None, (logs.fault, '' if states else _UNKNOWN, fault))
        void = signature_faults(signatures, self.name, self.sha256, self.persons)
        first, last_one = self._span_of(logs.entries)
        during = logs.entries[first:last_one]
        alarms = [alarm_of(e.new) for e in during if e.kind == ALARM]
        last = {alarm.key: alarm for alarm in alarms}
        in_log = InLog.DIFFERS if fault else InLog.AGREES if states else InLog.ABSENT
        return replace(
            self,
            changes=tuple(e for e in during if e.kind != ALARM),
            alarms=tuple(last.values()),
            in_log=in_log,
            log=logs.identity,
            signatures=signatures,
            software=software_in(logs.entries[:last_one]),
            faults=(*self.faults, *faults, *void),
        )

    def _fault_by(self, states: Sequence[RecordState], data: bytes) -> str:
        """Return how a record contradicts its states in the audit log, or an empty string."""
        has_end = any(each.event == ENDED for each in states)
        lacks = bool(states and self.end and not has_end)
        own = 'it has an end that is not in the audit log' if lacks else ''
        return fault_of(data, states) or own

    def _span_of(self, entries: Sequence[Entry]) -> tuple[int, int | None]:
        """Return begin and end of the slice of the entries that were made during the batch.

        The slice begins after the entry with the hash `after`, or with the first entry if the log
        was empty before the batch. If no entry has the hash `after`, the slice begins with the
        first state of the record. The slice is found by hashes, because times would leave out
        entries if the clock was set back. The slice ends with the state that ended the batch. The
        end is None if the batch has not ended.
        """
        own = [n for n, e in enumerate(entries) if (e.kind, e.subject) == (RECORD, self.name)]
        begin = [n for n, e in enumerate(entries) if e.hash == self.after]
        ends = [n for n in own if has_ended(entries[n].new)]
        first = begin[0] + 1 if begin else 0 if self.after == FIRST_PREVIOUS else (own or [0])[0]
        return first, ends[0] + 1 if ends else None


def of_results(name: str, source: str, results: Sequence[ItemResult], product: Product) -> Batch:
    """Return a batch of the items that were weighed from the bag `source`.

    Raises `ValueError` if an item was accepted without a mass.
    """
    items = tuple(_item(result.verdict, product.tare) for result in results)
    return Batch(name, source, (Part(product, items),))


def read_csv(path: Path, product: Product) -> Batch:
    """Return the batch in a CSV file of the command `weigh` or `replay`.

    All items belong to `product`. Raises `BatchError` if the file lacks a column or a row is not
    valid, and OSError if the file cannot be read.
    """
    data = path.read_bytes()
    rows = csv.DictReader(io.StringIO(data.decode('utf-8', errors='replace')))
    needed = {'item_id', 't3', 'mass_g', 'decision', 'reasons'}
    if missing := sorted(needed - set(rows.fieldnames or ())):
        raise BatchError(f'{path}: is not a CSV file of weigh: it lacks {", ".join(missing)}')
    items = []
    for row in rows:
        try:
            items.append(_item_of_row(row, product.tare))
        except (KeyError, TypeError, ValueError) as error:
            raise BatchError(f'{path}:{rows.line_num}: is not an item: {error}') from None
    parts = (Part(product, tuple(items)),)
    return Batch(path.stem, path.name, parts, sha256=hashlib.sha256(data).hexdigest())


def read_record(path: Path) -> Batch:
    """Return the batch that a record contains. Raises `RecordError` if the record is not valid."""
    lines: dict[str, list[Any]] = defaultdict(list)
    products = {'': Product('', math.nan)}
    items: dict[str, list[BatchItem]] = defaultdict(list)
    strays = 0
    events = list(read_events(path))
    for number, (kind, event) in enumerate(events, 1):
        if kind == 'product':
            products[event.name] = event
        elif kind != 'verdict':
            lines[kind].append(event)
        elif event.product and event.batch != lines['begin'][0]['batch']:
            strays += 1
        else:
            product = products.get(event.product, products[''])
            try:
                items[product.name].append(_item(event, product.tare))
            except ValueError as error:
                raise RecordError(f'{path}:{number}: {error}') from None
    if not lines['begin']:
        raise RecordError(f'{path}: is empty')
    begin, end = lines['begin'][-1], (lines['end'] or [{}])[-1]
    return Batch(
        begin['batch'],
        path.name,
        tuple(Part(products[name], tuple(each)) for name, each in items.items()),
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        begin=str(begin.get('time', '')),
        end=str(end.get('time', '')),
        stops=tuple(lines['stop']),
        corrections=tuple(lines['filler']),
        faults=tuple(_faults(path, begin['batch'], events)),
        strays=strays,
        after=str(begin.get('audit_hash', '')),
    )


def read_recorded(path: Path, log: Path | None = None) -> Batch:
    """Read the record of a batch, and compare it with the audit log.

    If `log` is None, the log is that of the machine whose folder contains the record. The name of a
    log in the record is not used, because a forger of the record could name a forged log. If the
    machine has no log, a fault is added to the batch. Raises `RecordError` if the record cannot be
    read, and `AuditError` if the log cannot be read.
    """
    batch = read_record(path)
    own = path.resolve().parents[1] / LOG_FILE
    if log is None and not own.is_file():
        return replace(batch, faults=(*batch.faults, _NO_LOG))
    return batch.with_log(read_chain(log or own), path.read_bytes())


def _faults(path: Path, batch: str, events: Sequence[tuple[str, Any]]) -> Iterator[str]:
    """Yield the faults of a record that can be found without an audit log."""
    if record_path(path.parent, batch).name != path.name:
        yield f'it is the record of batch {one_line(batch)!r}, but has the name of another record'
    yield from islice(count_faults(events), _MOST_FAULTS)


def _item(verdict: Verdict, tare: float) -> BatchItem:
    return BatchItem(verdict.decision, verdict.reasons, verdict.mass - tare, verdict.time)


def _item_of_row(row: dict[str, str], tare: float) -> BatchItem:
    mass = float(row['mass_g']) / GRAMS - tare if row['mass_g'] else math.nan
    reasons = tuple(filter(None, row['reasons'].split(';')))
    return BatchItem(Decision[row['decision']], reasons, mass)
