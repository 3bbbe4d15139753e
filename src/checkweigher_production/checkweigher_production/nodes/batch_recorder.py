# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of the batch on the line, and what it says of that batch after a restart."""

from pathlib import Path

from checkweigher_production.batch_record import (
    RecordError,
    RecordWriter,
    ended_record,
    last_record,
    read_lines,
    record_path,
    verdict_of,
)
from checkweigher_production.recipes import product_of
from checkweigher_production.statistics import ProductionRecord


class BatchRecorder(RecordWriter):
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
        super().__init__(folder)
        if ended:  # the line may have been cut off before that was in the audit log
            self.ended.put(ended)
        self.begin(production.batch, time, **audit)

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

    def has(self, batch: str) -> bool:
        """Tell whether there is a record of a batch."""
        return record_path(self._folder, batch).exists()

    def change(self, batch: str, time: str) -> None:
        """End the record and begin that of another batch."""
        self.end(time)
        self.begin(batch, time, **self._audit)
