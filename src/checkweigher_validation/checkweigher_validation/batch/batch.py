# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A batch with its items, from results, from their CSV or from the record of the line."""

from collections.abc import Sequence
import csv
from dataclasses import dataclass, replace
from enum import StrEnum
import hashlib
import io
import math
from pathlib import Path
from typing import Any

from checkweigher_core.changes import RECORD
from checkweigher_core.records import GRAMS, NANOSECONDS, Decision, Verdict
from checkweigher_production.audit_log import Entry
from checkweigher_production.batch_record import RecordError, read_lines, verdict_of
from checkweigher_production.recipes import Product, product_of
from checkweigher_validation.accuracy.results import ItemResult


class BatchError(ValueError):
    """A batch that cannot be read; one line that names the file, the place and the error."""


class InLog(StrEnum):
    """How the SHA-256 of a record compares with the latest that the audit log has of its batch."""

    AGREES = 'agrees'
    DIFFERS = 'differs'
    ABSENT = 'not in the log'


@dataclass(frozen=True, slots=True)
class BatchItem:
    """One item; its mass is of the contents, kg, NaN if it was not weighed.

    ValueError if it was accepted without a mass.
    """

    number: int
    stamp: int | None  # t3, ns
    decision: Decision
    reasons: tuple[str, ...]
    mass: float

    def __post_init__(self) -> None:
        # The rules and the reference test are of the masses of all accepted items.
        if self.decision is Decision.ACCEPT and not math.isfinite(self.mass):
            raise ValueError('it is ACCEPT without a mass')


@dataclass(frozen=True, slots=True)
class Part:
    """The items of one product in a batch, in the order of their verdicts."""

    product: Product
    items: tuple[BatchItem, ...]


@dataclass(frozen=True, slots=True)
class Batch:
    """What passed in a batch.

    `stops` and `corrections` are the lines of the record, `changes` the entries of the audit log of
    that time; `source` is the file, of which `sha256` is the hash if it is one.
    `in_log` is None where there is no log to hold the record to.
    """

    name: str
    source: str
    parts: tuple[Part, ...]
    sha256: str = ''
    begin: str = ''  # ISO 8601; empty where it is not known
    end: str = ''
    stops: tuple[dict[str, Any], ...] = ()
    corrections: tuple[dict[str, Any], ...] = ()
    changes: tuple[Entry, ...] = ()
    in_log: InLog | None = None
    strays: int = 0  # items of another batch in the record of this one

    def with_log(self, entries: Sequence[Entry]) -> 'Batch':
        """Return the batch of a record, held to an audit log, with its entries of that time."""
        end = self.end or '~'
        found = [e.new for e in entries if (e.kind, e.subject) == (RECORD, self.name)]
        in_log = InLog.ABSENT
        if found:
            in_log = InLog.AGREES if found[-1] == self.sha256 else InLog.DIFFERS
        return replace(
            self, changes=tuple(e for e in entries if self.begin <= e.time <= end), in_log=in_log
        )


def of_results(name: str, source: str, results: Sequence[ItemResult], product: Product) -> Batch:
    """Return the batch of items that were weighed offline."""
    items = tuple(_item(result.verdict, product.tare) for result in results)
    return Batch(name, source, (Part(product, items),))


def read_csv(path: Path, product: Product) -> Batch:
    """Return the batch in a CSV file of `weigh` or `replay`; `BatchError` if it is none."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BatchError(f'{path}: {error.strerror}') from None
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
    part = Part(product, tuple(items))
    return Batch(path.stem, str(path), (part,), sha256=hashlib.sha256(data).hexdigest())


def read_record(path: Path) -> Batch:
    """Return the batch of a record of the line; `RecordError` if it is none."""
    begin: dict[str, Any] = {}
    end: dict[str, Any] = {}
    products = {'': Product('', math.nan)}
    items: dict[str, list[BatchItem]] = {}
    told: dict[str, list[dict[str, Any]]] = {'stop': [], 'filler': []}
    strays = 0
    for number, values in enumerate(read_lines(path), 1):
        try:
            match values.pop('kind'):
                case 'begin':
                    begin |= values
                case 'end':
                    end |= values
                case 'product':
                    product = product_of(values)
                    products[product.name] = product
                case 'verdict':
                    verdict = verdict_of(values)
                    if verdict.product and verdict.batch != begin['batch']:
                        strays += 1
                        continue
                    product = products.get(verdict.product, products[''])
                    items.setdefault(product.name, []).append(_item(verdict, product.tare))
                case 'stop' | 'filler' as kind:
                    told[kind].append(values)
        except (KeyError, TypeError, ValueError) as error:
            raise RecordError(f'{path}:{number}: {error}') from None
    if not begin:
        raise RecordError(f'{path}: is empty')
    return Batch(
        begin['batch'], str(path),
        tuple(Part(products[name], tuple(each)) for name, each in items.items()),
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        begin=str(begin['time']), end=str(end.get('time', '')),
        stops=tuple(told['stop']), corrections=tuple(told['filler']), strays=strays,
    )  # fmt: skip


def _item(verdict: Verdict, tare: float) -> BatchItem:
    mass = verdict.mass - tare
    return BatchItem(verdict.item_id, verdict.t3, verdict.decision, verdict.reasons, mass)


def _item_of_row(row: dict[str, str], tare: float) -> BatchItem:
    whole, _, part = row['t3'].partition('.')
    stamp = int(whole) * NANOSECONDS + int(part.ljust(9, '0')) if whole else None
    mass = float(row['mass_g']) / GRAMS - tare if row['mass_g'] else math.nan
    reasons = tuple(filter(None, row['reasons'].split(';')))
    return BatchItem(int(row['item_id']), stamp, Decision[row['decision']], reasons, mass)
