# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches of a line, which continue after a restart: counts, records and filler feedback."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from checkweigher_core.health.findings import Finding, conclude, error_if, warn_if
from checkweigher_core.parameters import SettingsError
from checkweigher_core.records import FillerFeedback, ProductOnLine, Verdict
from checkweigher_core.settings_files import plain
from checkweigher_production.audit_log import AuditLog
from checkweigher_production.batch_record import (
    RecordError,
    RecordState,
    RecordWriter,
    read_events,
    record_path,
    records_in,
    states_in,
)
from checkweigher_production.filler_feedback import FillerController
from checkweigher_production.recipes import Product
from checkweigher_production.selection import Selection, read_selection, write_selection
from checkweigher_production.statistics import ProductionRecord

_PATIENCE = 5.0  # longest wait in s for the states of opened records


class LineBatches:
    """Counts of the batches of a line, with a record of each batch in the folder `folder`.

    If `folder` is empty, there are no records. With a folder, the batch of the last run continues
    with its product and counts. If this batch is uncertain or its counts are lost, a person must
    begin a batch. `first` is the name of the batch if no batch is continued. `clock` returns the
    time for the records (ISO 8601, UTC), and `log` is the audit log of the line or None.

    Raises `RecordError` if the folder cannot be created.

    Attributes
    ----------
    production : ProductionRecord
        Counts of all products and batches.
    selected : Selection or None
        Selection of the last run, or None if there was none or it is unknown.
    doubt : str
        Reason why no batch is in progress, or empty.
    not_kept : str
        Reason why product and batch could not be saved for the next start, or empty.
    broken : str
        Reason why a record that was opened is broken, or empty.
    """

    def __init__(
        self, first: str, folder: str, clock: Callable[[], str], log: AuditLog | None
    ) -> None:
        self.production = ProductionRecord(first)
        self.selected: Selection | None = None
        self.doubt = ''
        self._clock = clock
        self._log = log
        self._note: Callable[[RecordState], object] | None = None
        self._filler: FillerController | None = None
        self._corrected = '', 0.0  # last product, and its last filler correction in kg
        self._folder = Path(folder)
        self._writer: RecordWriter | None = None
        # Paths of the records without an end, by batch name, except the present record.
        self._open: dict[str, Path] = {}
        self._left_out: list[str] = []  # faults of invalid records
        self._forgotten = ''  # reason why the last selection is unknown, or empty
        self._batch = self._before = ''  # batch of the present record, and the batch before it
        self._kept: Selection | None = None  # stored selection, or None if unknown
        self.not_kept = self.broken = ''
        if folder:
            self._writer = RecordWriter(self._folder)
            self._open, self._left_out = records_in(self._folder)
            self._resume(self._writer)

    @property
    def in_doubt(self) -> bool:
        """Whether a person must select the product or begin a batch after a restart."""
        return bool(self.doubt or self._forgotten)

    def _resume(self, writer: RecordWriter) -> None:
        try:
            self.selected = read_selection(self._folder, self._log.entries if self._log else ())
        except SettingsError as error:
            self._forgotten = str(error)
        try:
            if self.selected is None:
                batch = before = self._batch_in_progress(self.production.batch)
            else:
                batch, before = self.selected.batch, self.selected.before
            self._continue(writer, batch, before)
        except RecordError as error:
            names = ', '.join(map(repr, self._open)) or 'none'
            self.doubt = f'{error}; begin a new batch, or one that has not ended: {names}'
            self.selected, self.production.batch = None, ''

    def open(self, note: Callable[[RecordState], object]) -> None:
        """Begin to write events to the records. `note` writes a record state to the audit log.

        Before an event is added, the audit log must state that the record continues. Without this
        entry, an event before a kill would look as if it had been added while the machine was off.
        """
        self._note = note
        self._note_states()
        if self._writer is not None and not self.doubt:
            self.use(self.selected.product if self.selected else None)

    def _note_states(self) -> None:
        if self._writer is not None and self._note is not None:
            self._writer.settle(_PATIENCE)
            for state in self.states():
                self._note(state)

    def _batch_in_progress(self, first: str) -> str:
        """Return the only batch without an end or, if there is none, the batch `first`.

        Raises `RecordError` if the batch in progress is uncertain because several records have no
        end or a record is not valid. Raises `RecordError` as well if all records have ended, and
        the batch `first` has a record.
        """
        if len(self._open) > 1 or self._left_out:
            several = '; '.join([*map(str, self._open.values()), *self._left_out])
            raise RecordError(f'it is not certain which batch is in progress: {several}')
        if not self._open and (path := record_path(self._folder, first)).exists():
            raise RecordError(f'{path}: the batch {first!r} of product.batch has ended')
        return next(iter(self._open), first)

    def _continue(self, writer: RecordWriter, batch: str, before: str) -> None:
        """Continue or begin the batch `batch`, and end the record of `before` if it has no end.

        `before` is the name of the previous batch. Raises `RecordError` if the record of `batch`
        is missing, has ended or is not valid, although this batch was in progress.
        """
        self.production.batch, path = batch, record_path(self._folder, batch)
        interrupted = before != batch and before in self._open
        goes_on = self._open.pop(batch, None) is not None
        if goes_on:
            self._restore(path)
        elif self.selected is not None and (path.exists() or not interrupted):
            raise RecordError(f'{path}: the batch was in progress, and its counts are lost')
        if before != batch and record_path(self._folder, before).exists():
            # Reopen the previous record, because its end or its audit log entry may be missing.
            self._reopen(writer, before)
            self._open.pop(before, None)
        if goes_on:
            writer.end(self._clock())
            self._reopen(writer, batch)
        else:
            self._write_begin(writer)
        self._batch, self._before = batch, before

    def _reopen(self, writer: RecordWriter, batch: str) -> None:
        entries = self._log.entries if self._log else ()
        writer.resume(batch, self._clock(), states_in(entries, batch))
        self._note_states()

    def _restore(self, path: Path) -> None:
        """Restore the counts and the correction of the filler from a record.

        Raises `RecordError` if the record is not valid.
        """
        production = self.production
        try:
            for kind, event in read_events(path):
                if kind == 'product':
                    production.product = event
                    if event.name != self._corrected[0]:
                        self._corrected = event.name, 0.0
                elif kind == 'verdict' and event.batch in ('', production.batch):
                    production.add(event)
                elif kind == 'filler':
                    self._corrected = event.product, event.correction
                elif kind == 'reset':
                    production.reset()
        finally:
            # The product of the record is in use again only after `use` is called.
            production.product = None

    def keep(self, limits: ProductOnLine | None, *, always: bool = False) -> None:
        """Save product, limits and batch if they have changed or `always` is True.

        Nothing is saved without a folder, or while no batch is in progress. If the file cannot be
        written, the reason is stored in `not_kept`.
        """
        if self._writer is None or self.doubt:
            return
        its = self.production
        before = self._before if its.batch == self._batch else self._batch
        now = Selection.of(its.batch, before, its.product, limits)
        if self._kept == now and not always:
            return
        self._kept = None
        try:
            entry = self._log.last_hash if self._log else ''
            write_selection(self._folder, replace(now, entry=entry))
            self._kept, self.not_kept, self._forgotten = now, '', ''
        except OSError as error:
            self.not_kept = f'{error.filename or self._folder}: {error.strerror or error}'

    def write(self, kind: str, values: object) -> None:
        """Write a line of the kind `kind` to the record of the batch, if batches are recorded."""
        if self._writer is not None:
            self._writer.write(kind, values)

    def use(self, product: Product | None) -> None:
        """Set the product for which the following items are counted, and write it to the record.

        If `product` is None, the items are counted without a product.
        """
        self.production.product = product
        if product is not None:
            self.write('product', {'name': product.name, **plain(product)})

    def control_filler(self, product: Product) -> None:
        """Begin the feedback to the filler for a product, or end it if the recipe has no filler.

        The feedback continues with the last correction of this product if the correction is known.
        """
        last, correction = self._corrected
        correction = correction if last == product.name else 0.0
        self._corrected, self._filler = (product.name, correction), None
        if product.filler is not None:
            self._filler = FillerController(
                product.filler, product.name, product.nominal, product.tare, correction
            )

    def add(self, verdict: Verdict) -> bool:
        """Count and record an item if it is new; return whether it is new."""
        if is_new := self.production.add(verdict):
            self.write('verdict', verdict)
        return is_new

    def feedback(self, verdict: Verdict) -> FillerFeedback | None:
        """Return and record the feedback to the filler, or return None without feedback.

        There is feedback if the item completes a subgroup and the product has a filler.
        """
        found = self._filler.add(verdict) if self._filler is not None else None
        if found is not None:
            self._corrected = found.product, found.correction
            self.write('filler', found)
        return found

    def reset(self) -> None:
        """Reset the counts of the present product in the present batch."""
        self.production.reset()
        self.write('reset', {'time': self._clock()})

    def begin(self) -> None:
        """Begin or continue the record of the present batch, and end the previous record.

        Raises `RecordError` if a record to be continued is not valid.
        """
        if self._writer is not None:
            if path := self._open.get(self.production.batch):
                self._restore(path)
                self._reopen(self._writer, self.production.batch)
                del self._open[self.production.batch]
            else:
                self._write_begin(self._writer)
        self.doubt, self._before, self._batch = '', self._batch, self.production.batch
        self.use(self.production.product)

    def _write_begin(self, writer: RecordWriter) -> None:
        log = self._log
        audit = {'audit_log': str(log.path), 'audit_hash': log.last_hash} if log else {}
        writer.begin(self.production.batch, self._clock(), **audit)

    def has_record(self, batch: str) -> bool:
        """Return whether a batch has a record. The result is False if `folder` is empty."""
        return self._writer is not None and record_path(self._folder, batch).exists()

    def may_begin(self, batch: str) -> bool:
        """Return whether a batch with the name `batch` may begin.

        The name must be unused. If no batch is in progress after a restart, `batch` may also be the
        name of a batch whose record has no end, and this batch continues.
        """
        if self.doubt and batch in self._open:
            return True
        return not (self.production.has_batch(batch) or self.has_record(batch))

    def note(self) -> None:
        """Add the present state of the record to the states that `states` yields."""
        if self._writer is not None:
            self._writer.note()

    def states(self) -> Iterator[RecordState]:
        """Yield and remove each waiting record state that must be written to the audit log.

        If a state says that its record is broken, `broken` is set.
        """
        while self._writer is not None and not self._writer.states.empty():
            state = self._writer.states.get()
            if state.broken:
                self.broken = f'batch {state.batch!r}: {state.broken}'
            yield state

    def record_of(self, batch: str) -> Path:
        """Return the absolute path of the record of a batch."""
        return record_path(self._folder, batch).resolve()

    def close(self) -> None:
        """Close the record of the present batch without an end, so that a restart continues it."""
        if self._writer is not None:
            self._writer.close()

    def finding(self) -> Finding:
        """Return the diagnostics finding "Batch record", with the faults of all batch records."""
        if self._writer is None:
            return conclude('Batch record', 'none: batches are not recorded', ())
        full = 'make room, or see to the disk: verdicts wait in memory'
        aside = 'it was left out; put it right, or move it to another folder'
        begun = [f'{path}: has begun and not ended' for path in self._open.values()]
        others = (*begun, *self._left_out, self._forgotten)
        concerns = (
            *(error_if(bool(text), text, full) for text in (self._writer.trouble, self.not_kept)),
            error_if(bool(self.doubt), self.doubt, 'nothing is accepted until then'),
            error_if(bool(self.broken), self.broken, 'the batch cannot be released'),
            *(warn_if(bool(text), text, aside) for text in others),
        )
        folder = str(self._folder)
        return conclude('Batch record', f'written to {folder}', concerns, {'folder': folder})
