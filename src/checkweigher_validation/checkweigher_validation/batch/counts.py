# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Comparison of the items in a batch record with the counts in its verdicts."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
import math
from typing import Any

from checkweigher_core.records import Decision, Verdict
from checkweigher_dsp.rejection.batch_rules import BatchTally, count
from checkweigher_production.recipes import Product

# Largest rounding error of a sum of masses, in kg for sums up to 1 kg, and as a fraction of larger
# sums.
_TOLERANCE = 1e-9


def count_faults(events: Iterable[tuple[str, Any]]) -> Iterator[str]:
    """Yield a sentence for each verdict with wrong counts.

    `events` are the kinds and contents of the lines of a record. The node `reject` has written the
    counts of the product in the batch to each verdict. These counts must be those of the previous
    verdict on the product plus the item of this verdict. The counts before the first verdict are 0.
    Verdicts without a product, or of another batch, are ignored. The number below TU1 and the
    surplus are not compared for a product whose recipe is not in the record, or has been changed in
    an earlier line.
    """
    batch, products = '', dict[str, Product]()
    tallies: dict[str, BatchTally] = {}
    changed: set[str] = set()  # products whose recipes have changed, so that sums may differ
    for number, (kind, event) in enumerate(events, 1):
        if kind == 'begin':
            batch = event['batch']
        elif kind == 'product':
            if products.get(event.name, event) != event:
                changed.add(event.name)
            products[event.name] = event
        elif kind == 'verdict' and event.product and event.batch == batch:
            known = tallies.get(event.product, BatchTally(event.product, batch))
            told = tallies[event.product] = BatchTally.of(event)
            found = _counted(event, known, products.get(event.product))
            if event.product in changed or event.product not in products:
                found = replace(found, below_tu1=told.below_tu1, surplus=told.surplus)
            if fault := _difference(found, told):
                yield f'line {number}: item {event.item_id}: {fault}'


def _counted(verdict: Verdict, known: BatchTally, product: Product | None) -> BatchTally:
    accepted = verdict.decision is Decision.ACCEPT
    on_line = (product or Product(verdict.product, math.nan)).on_line(verdict.batch)
    return count(verdict.mass, known, on_line, accepted=accepted)


def _difference(found: BatchTally, told: BatchTally) -> str:
    """Return the first difference between counts as a sentence, or an empty string if they agree.

    `found` contains the counts of the items in the record, and `told` those in the verdict.
    """
    for name in ('items', 'accepted', 'below_tu1'):
        here, there = getattr(found, name), getattr(told, name)
        if here != there:
            return f'its verdict counts {there} {name}, the record has {here}'
    if abs(found.surplus - told.surplus) > _TOLERANCE * max(1.0, abs(told.surplus)):
        there, here = (f'{each.surplus:+.6f} kg' for each in (told, found))
        return f'its verdict has the surplus {there}, the record has {here}'
    return ''
