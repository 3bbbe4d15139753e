# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of the batch on the line, and what it says of that batch after a restart."""

from collections.abc import Iterator
from pathlib import Path

from checkweigher_dsp.production.batch_record import (
    EndedRecord,
    RecordError,
    RecordWriter,
    ended_record,
    last_record,
    read_lines,
    record_path,
    verdict_of,
)
from checkweigher_dsp.production.recipes import product_of
from checkweigher_dsp.production.statistics import ProductionRecord


class BatchRecorder:
    """Write the record of each batch; take up the one that a restart has interrupted.

    The counts of an interrupted batch are put into `production`, which then goes on with its name.
    `correction` is that of the filler for `product` then.

    Raises
    ------
    RecordError
        If the folder or the record cannot be used, or the batch has ended before.
    """

    def __init__(
        self, folder: Path, production: ProductionRecord, time: str, audit: dict[str, str]
    ) -> None:
        self._folder = folder
        self._audit = audit
        self.product, self.correction = '', 0.0
        last = last_record(folder)
        ended = ended_record(last) if last else None
        if last and not ended:
            self._restore(last, production)
        elif record_path(folder, production.batch).exists():
            raise RecordError(
                f'{record_path(folder, production.batch)}: the batch {production.batch!r} has '
                'ended; name another one in product.batch'
            )
        self._writer = RecordWriter(folder)
        if ended:  # the line may have been cut off before that was in the audit log
            self._writer.ended.put(ended)
        self._writer.begin(production.batch, time, **audit)
        self.write = self._writer.write

    def _restore(self, path: Path, production: ProductionRecord) -> None:
        for values in read_lines(path):
            kind = values.pop('kind')
            if kind == 'begin':
                production.batch = str(values['batch'])
            elif kind == 'product':
                production.product = product_of(values)
                self.product, self.correction = production.product.name, 0.0
            elif kind == 'verdict':
                verdict = verdict_of(values)
                if verdict.batch in ('', production.batch):
                    production.add(verdict)
            elif kind == 'filler':
                self.correction = float(values['correction'])
            elif kind == 'reset':
                production.reset()
        production.product = None  # it is still to be selected

    @property
    def trouble(self) -> str:
        """Why nothing can be written at present, empty if it can."""
        return self._writer.trouble

    def has(self, batch: str) -> bool:
        """Tell whether there is a record of a batch."""
        return record_path(self._folder, batch).exists()

    def change(self, batch: str, time: str) -> None:
        """End the record and begin that of another batch."""
        self._writer.end(time)
        self._writer.begin(batch, time, **self._audit)

    def ended(self) -> Iterator[EndedRecord]:
        """Yield the records that are complete by now."""
        while not self._writer.ended.empty():
            yield self._writer.ended.get()

    def close(self) -> None:
        """Write what is left."""
        self._writer.close()
