# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The end of a count: another batch, or the statistics of this one from 0."""

from collections.abc import Iterator

from checkweigher_core import changes
from checkweigher_core.records import BatchResult, Statistics
from checkweigher_core.ros.line_parameters import RefusedError
from checkweigher_production.audit_log import AuditError
from checkweigher_production.audit_trail import AuditTrail
from checkweigher_production.authors import Author
from checkweigher_production.batch_record import RecordError
from checkweigher_production.nodes.batch_recorder import LineBatches
from checkweigher_production.nodes.line_recipe import LineRecipe
from checkweigher_production.nodes.performance import LineTest

# Statistics in the entries of the audit log.
_AUDITED = ('product', 'batch', 'items', 'accepted', 'under', 'over', 'faults', 'mean', 'std_dev')


class BatchChange:
    """Changes of the batch and resets of its statistics, in the audit log before they are made."""

    def __init__(
        self, batches: LineBatches, recipe: LineRecipe, trail: AuditTrail, test: LineTest
    ) -> None:
        self._batches = batches
        self._recipe = recipe
        self._trail = trail
        self._test = test

    async def begin(self, name: str, by: Author) -> Statistics:
        """Let the reject node count for another batch, then end the record of this one.

        Returns the statistics of the batch that ends; raises an error if none of that is done.
        """
        if not name or not self._batches.may_begin(name):
            raise RecordError(f'batch {name!r}: a name that was not used before is needed')
        production = self._batches.production
        finished = self._end_count(changes.BATCH, name, by)
        before, production.batch = production.batch, name
        try:
            await self._recipe.change(batch=name)
            self._batches.begin()
        except (AuditError, RecordError, RefusedError) as error:
            production.batch = before
            self._trail.saw(changes.REFUSED, 'batch', name, str(error), by)
            raise
        finally:
            self._batches.keep(self._recipe.selected, anew=True)
        if production.product is not None:
            self._test.select(production.product, name)
        return finished

    async def reset(self, by: Author) -> Statistics:
        """Count the product in this batch from 0, and return what was counted."""
        finished = self._end_count(changes.RESET, None, by)
        self._batches.reset()
        return finished

    def _end_count(self, kind: str, batch: str | None, by: Author) -> Statistics:
        """Write the end of a count to the audit log, and return its statistics."""
        finished = self._batches.production.summary()
        audited = {name: getattr(finished, name) for name in _AUDITED}
        self._trail.note(kind, 'statistics', audited, batch, by)
        return finished

    def ended(self) -> Iterator[BatchResult]:
        """Yield the batches whose record is complete, once its hash is in the audit log."""
        for ended in self._batches.ended():
            if self._trail.last(changes.RECORD, ended.batch) != ended.sha256:
                self._trail.saw_state(changes.RECORD, ended.batch, ended.sha256)
                yield ended
