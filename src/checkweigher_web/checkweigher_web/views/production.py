# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the production counts and of the packers' rules for the batch (76/211/EEC)."""

import math

from checkweigher_core.records import GRAMS, FillerFeedback, Statistics, Verdict
from checkweigher_dsp.rejection.batch_rules import ROUNDING, BatchTally
from checkweigher_web.elements import Table
from checkweigher_web.views.view import View
from checkweigher_web.words import grams, number


class ProductionView(View):
    """Counts of the product and the batch, and the state of the packers' rules."""

    title = 'Production'
    columns = 1, 3

    def _build(self) -> None:
        self._counts = Table(('what', 'value'))
        self._rules = Table(('rule for the batch', 'how it stands'))

    def _show(self) -> None:
        statistics, item = self.lane.statistics, self.drawing.latest()
        self._counts.show(production(statistics, self.lane.filler))
        self._rules.show(batch_rules(statistics, None if item is None else item.verdict))


def production(known: Statistics | None, filler: FillerFeedback | None) -> list[tuple[str, str]]:
    """Return the counts of the product and the batch, and the correction of the filler."""
    if known is None:
        return [('', 'no statistics: the node product does not run')]
    counts = {
        'product': known.product or 'none',
        'batch': known.batch or 'none',
        'items': known.items,
        'accepted': known.accepted,
        'under': known.under,
        'over': known.over,
        'faults': known.faults,
        **dict(zip(known.reasons, known.reason_counts, strict=True)),
        'net mean, g': grams(known.mean),
        'std dev, g': grams(known.std_dev),
        'giveaway, g': grams(known.giveaway),
        'below TU1': known.below_tu1,
        'below TU2': known.below_tu2,
        'items/min': number(known.throughput, 1),
    }
    return [*((name, str(value)) for name, value in counts.items()), *_correction(known, filler)]


def _correction(known: Statistics, filler: FillerFeedback | None) -> list[tuple[str, str]]:
    if filler is None or filler.product != known.product:
        return []
    text = f'{GRAMS * filler.correction:+.3f}, at a median of {grams(filler.median)}'
    return [('filler correction, g', f'{text}; limited' if filler.limited else text)]


def batch_rules(known: Statistics | None, latest: Verdict | None) -> list[tuple[str, str]]:
    """Return the packers' rules for the present batch, each with its present state.

    The statistics in `known` have the rules of the recipe, and the `latest` verdict has the counts
    on which the rules depend.
    """
    if known is None or not math.isfinite(known.nominal):
        return []
    tally = BatchTally() if latest is None else BatchTally.of(latest)
    if tally.key != (known.product, known.batch):  # No item of this batch has passed yet.
        tally = BatchTally(known.product, known.batch)
    none_below = f'{_kept(not known.below_tu2)}{known.below_tu2} accepted'
    return [
        ('net mean at least nominal', _mean_rule(known, tally)),
        (f'share below TU1, {grams(known.tu1)} g net', _tu1_rule(known, tally)),
        (f'none below TU2, {grams(known.tu2)} g net', none_below),
    ]


def _mean_rule(known: Statistics, tally: BatchTally) -> str:
    if not known.mean_value:
        return f'not asked by the recipe; the mean is {grams(known.mean)} g'
    if not tally.accepted:
        return 'nothing accepted yet'
    mean = known.nominal + tally.surplus / tally.accepted
    return (
        f'{_kept(mean >= known.nominal * (1 - ROUNDING))}{grams(mean)} g of '
        f'{grams(known.nominal)} g; an item may lack {grams(max(tally.surplus, 0.0), " g")}'
    )


def _tu1_rule(known: Statistics, tally: BatchTally) -> str:
    quota = known.tu1_quota
    if not math.isfinite(quota):
        part = number(100 * known.share_below_tu1, 2, ' %')
        return f'not asked by the recipe; {known.below_tu1} accepted, {part}'
    share = tally.below_tu1 / tally.accepted if tally.accepted else 0.0
    what = 'is accepted' if tally.has_room(quota) else 'is rejected, TU1Quota'
    return (
        f'{_kept(share <= quota * (1 + ROUNDING))}{tally.below_tu1} of {tally.accepted} accepted, '
        f'{100 * share:.2f} % of at most {100 * quota:g} %; the next one {what}'
    )


def _kept(kept: bool) -> str:
    return '✓ ' if kept else '✗ '
