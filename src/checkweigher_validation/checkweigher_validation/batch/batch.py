# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batch of items, from results, from a CSV file of results, or from a batch record."""

from collections import defaultdict
from collections.abc import Sequence
import csv
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
import hashlib
import io
import math
from pathlib import Path
from typing import Any

from checkweigher_core.changes import ALARM, RECORD
from checkweigher_core.records import GRAMS, Alarm, Decision, Verdict
from checkweigher_production.alarms import alarm_of
from checkweigher_production.audit_log import Entry
from checkweigher_production.batch_record import RecordError, read_events
from checkweigher_production.recipes import Product
from checkweigher_validation.accuracy.results import ItemResult


class BatchError(ValueError):
    """Error for a batch that cannot be read. The message has the file, the line and the fault."""


class InLog(StrEnum):
    """Result of the comparison of the SHA-256 digest of a record with that in the audit log."""

    AGREES = 'agrees'
    DIFFERS = 'differs'
    ABSENT = 'not in the log'


@dataclass(frozen=True, slots=True)
class BatchItem:
    """Item of a batch. Raises `ValueError` if the item was accepted without a mass."""

    decision: Decision
    reasons: tuple[str, ...]
    mass: float  # mass of the contents in kg, NaN if the item was not weighed

    def __post_init__(self) -> None:
        # The rules for batches and the reference test need the masses of all accepted items.
        if self.decision is Decision.ACCEPT and not math.isfinite(self.mass):
            raise ValueError('it is ACCEPT without a mass')


@dataclass(frozen=True, slots=True)
class Part:
    """Items of one product in a batch, in the order of their verdicts."""

    product: Product
    items: tuple[BatchItem, ...]


@dataclass(frozen=True, slots=True)
class Batch:
    """Items and events of a batch. An unknown text is empty."""

    name: str
    source: str  # path of the file or the bag
    parts: tuple[Part, ...]
    sha256: str = ''  # SHA-256 digest of the file
    begin: str = ''  # ISO 8601
    end: str = ''  # ISO 8601
    stops: tuple[dict[str, Any], ...] = ()  # stop requests in the record
    corrections: tuple[dict[str, Any], ...] = ()  # feedback to the filler in the record
    changes: tuple[Entry, ...] = ()  # entries of the audit log during the batch except alarms
    alarms: tuple[Alarm, ...] = ()  # last state of each alarm that changed during the batch
    in_log: InLog | None = None  # None without an audit log
    strays: int = 0  # number of items in the record that belong to another batch

    def with_log(self, entries: Sequence[Entry]) -> 'Batch':
        """Return the batch with the changes and alarms in an audit log, and `in_log`."""
        found = [e.new for e in entries if (e.kind, e.subject) == (RECORD, self.name)]
        in_log = InLog.ABSENT
        if found:
            in_log = InLog.AGREES if found[-1] == self.sha256 else InLog.DIFFERS
        during = [e for e in entries if self.begin <= e.time <= (self.end or '~')]
        alarms = [alarm_of(e.new) for e in during if e.kind == ALARM]
        last = {(alarm.source, alarm.reason, alarm.first): alarm for alarm in alarms}
        changes = tuple(e for e in during if e.kind != ALARM)
        return replace(self, changes=changes, alarms=tuple(last.values()), in_log=in_log)


def of_results(name: str, source: str, results: Sequence[ItemResult], product: Product) -> Batch:
    """Return a batch of items that were weighed from a bag."""
    items = tuple(_item(result.verdict, product.tare) for result in results)
    return Batch(name, source, (Part(product, items),))


def read_csv(path: Path, product: Product) -> Batch:
    """Return the batch in a CSV file of `weigh` or `replay`.

    Raises `BatchError` if the file is not such a file.
    """
    data = path.read_bytes()
    rows = csv.DictReader(io.StringIO(data.decode('utf-8', errors='replace')))
    needed = {'item_id', 't3', 'mass_g', 'decision', 'reasons'}
    if missing := sorted(needed - set(rows.fieldnames or ())):
        raise BatchError(f'{path}: no CSV of weigh or replay: it lacks {", ".join(missing)}')
    items = []
    for row in rows:
        try:
            items.append(_item_of_row(row, product.tare))
        except (KeyError, TypeError, ValueError) as error:
            raise BatchError(f'{path}:{rows.line_num}: is no item: {error}') from None
    parts = (Part(product, tuple(items)),)
    return Batch(path.stem, str(path), parts, sha256=hashlib.sha256(data).hexdigest())


def read_record(path: Path) -> Batch:
    """Return the batch in a batch record. Raises `RecordError` if the record is not valid."""
    lines: dict[str, list[dict[str, Any]]] = defaultdict(list)
    products = {'': Product('', math.nan)}
    items: dict[str, list[BatchItem]] = defaultdict(list)
    strays = 0
    for number, (kind, event) in enumerate(read_events(path), 1):
        if kind == 'product':
            products[event.name] = event
        elif kind != 'verdict':
            lines[kind].append(asdict(event) if kind == 'filler' else event)
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
        str(path),
        tuple(Part(products[name], tuple(each)) for name, each in items.items()),
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        begin=str(begin['time']),
        end=str(end.get('time', '')),
        stops=tuple(lines['stop']),
        corrections=tuple(lines['filler']),
        strays=strays,
    )


def _item(verdict: Verdict, tare: float) -> BatchItem:
    return BatchItem(verdict.decision, verdict.reasons, verdict.mass - tare)


def _item_of_row(row: dict[str, str], tare: float) -> BatchItem:
    mass = float(row['mass_g']) / GRAMS - tare if row['mass_g'] else math.nan
    reasons = tuple(filter(None, row['reasons'].split(';')))
    return BatchItem(Decision[row['decision']], reasons, mass)
