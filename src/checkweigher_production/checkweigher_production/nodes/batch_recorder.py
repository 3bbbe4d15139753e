# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The batches of a line: counts, records, and the feedback to the filler, across restarts."""

from collections.abc import Callable, Iterator
from pathlib import Path

from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.records import BatchResult, FillerFeedback, Verdict
from checkweigher_core.settings_files import plain
from checkweigher_production.batch_record import (
    RecordError,
    RecordWriter,
    ended_record,
    last_record,
    read_lines,
    record_path,
    verdict_of,
)
from checkweigher_production.filler_feedback import FillerController
from checkweigher_production.recipes import Product, product_of
from checkweigher_production.statistics import ProductionRecord


class LineBatches:
    """Counts of the batches of a line, with a record of each batch if there is a folder for it.

    A batch whose record was interrupted by a restart goes on with its name and its counts, which
    are in `production`. `batch` is the name at the start, `clock` returns the time for the records
    (ISO 8601, UTC), and `audit` has file and last hash of the audit log for their begin.

    Raises `RecordError` if the folder or a record cannot be used, or the batch has ended before.
    """

    def __init__(
        self, batch: str, folder: str, clock: Callable[[], str], audit: dict[str, str]
    ) -> None:
        self.production = ProductionRecord(batch)
        self._clock = clock
        self._audit = audit
        self._filler: FillerController | None = None
        self._corrected = '', 0.0  # last product, and the correction of the filler for it
        self._folder = Path(folder)
        self._writer: RecordWriter | None = None
        if folder:
            self._open()

    def _open(self) -> None:
        last, batch = last_record(self._folder), self.production.batch
        ended = ended_record(last) if last else None
        if last and not ended:
            self._restore(last)
        elif (path := record_path(self._folder, batch)).exists():
            raise RecordError(
                f'{path}: the batch {batch!r} has ended; name another one in product.batch'
            )
        self._writer = RecordWriter(self._folder)
        if ended:  # the process may have ended before the hash was in the audit log
            self._writer.ended.put(ended)
        self._writer.begin(self.production.batch, self._clock(), **self._audit)

    def _restore(self, path: Path) -> None:
        production = self.production
        for values in read_lines(path):
            kind = values.pop('kind')
            if kind == 'begin':
                production.batch = str(values['batch'])
            elif kind == 'product':
                production.product = product_of(values)
                self._corrected = production.product.name, 0.0
            elif kind == 'verdict':
                verdict = verdict_of(values)
                if verdict.batch in ('', production.batch):
                    production.add(verdict)
            elif kind == 'filler':
                self._corrected = self._corrected[0], float(values['correction'])
            elif kind == 'reset':
                production.reset()
        production.product = None  # it is still to be selected

    def write(self, kind: str, values: object) -> None:
        """Write a line to the record of the batch."""
        if self._writer is not None:
            self._writer.write(kind, values)

    def use(self, product: Product | None) -> None:
        """Count for a product from now on."""
        self.production.product = product
        if product is not None:
            self.write('product', {'name': product.name, **plain(product)})

    def control_filler(self, product: Product) -> None:
        """Begin to control the filler for a product, or go on with its last correction."""
        last, correction = self._corrected
        self._corrected = product.name, correction if last == product.name else 0.0
        self._filler = None
        if product.filler is not None:
            self._filler = FillerController(
                product.filler, product.name, product.nominal, product.tare, correction
            )

    def add(self, verdict: Verdict) -> bool:
        """Count and record an item; return False if it was counted before a restart."""
        is_new = self.production.add(verdict)
        if is_new:
            self.write('verdict', verdict)
        return is_new

    def feedback(self, verdict: Verdict) -> FillerFeedback | None:
        """Return and record the feedback to the filler if an item completes a subgroup."""
        found = self._filler.add(verdict) if self._filler is not None else None
        if found is not None:
            self._corrected = found.product, found.correction
            self.write('filler', found)
        return found

    def reset(self) -> None:
        """Count the product in this batch from 0."""
        self.production.reset()
        self.write('reset', {'time': self._clock()})

    def begin(self) -> None:
        """End the record of the previous batch, and begin that of the present one."""
        if self._writer is not None:
            self._writer.end(self._clock())
            self._writer.begin(self.production.batch, self._clock(), **self._audit)
        self.use(self.production.product)

    def has_record(self, batch: str) -> bool:
        """Return whether there is a record of a batch."""
        return self._writer is not None and record_path(self._folder, batch).exists()

    def ended(self) -> Iterator[BatchResult]:
        """Yield the batches whose records were completed since the last call, with the stamp 0."""
        while self._writer is not None and not self._writer.ended.empty():
            yield self._writer.ended.get()

    def close(self) -> None:
        """Close the record."""
        if self._writer is not None:
            self._writer.close()

    def finding(self) -> Finding:
        """Return the aspect Batch record of the diagnostics."""
        if self._writer is None:
            return conclude('Batch record', 'none: batches are not recorded', ())
        found = []
        if trouble := self._writer.trouble:
            hint = 'make room, or see to the disk: verdicts wait in memory'
            found.append(Concern(Level.ERROR, trouble, hint))
        folder = str(self._folder)
        return conclude('Batch record', f'written to {folder}', found, {'folder': folder})
