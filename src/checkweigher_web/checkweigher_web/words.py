# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts, masses, times and reasons in the words of the page."""

from datetime import UTC, datetime
import math

from checkweigher_core.records import GRAMS, NANOSECONDS, FillerFeedback, Statistics, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.rejection.batch_rules import ROUNDING, BatchTally
from checkweigher_web.lane import Item

# Colour is never the only sign.
_SIGNS = {'ACCEPT': '✓', 'UNDER': '↓', 'OVER': '↑', 'FAULT': '✗'}


def decided(verdict: Verdict) -> str:
    """Return the decision of a verdict with its sign."""
    name = verdict.decision.name
    return f'{_SIGNS[name]} {name}'


def said(verdict: Verdict) -> str:
    """Return a verdict in words, with its reasons."""
    return ' '.join((decided(verdict), ', '.join(verdict.reasons))).rstrip()


def about(item: Item) -> str:
    """Return what is known of an item beside its mass."""
    verdict, known = item.verdict, item.estimate
    parts = [f'item {verdict.item_id}', *(['gross'] if math.isfinite(verdict.mass) else [])]
    if math.isfinite(verdict.std_dev):
        parts.append(f'± {GRAMS * verdict.std_dev:.2f} g')
    if known is not None:
        if math.isfinite(known.belt_speed):
            parts.append(f'{60 * known.belt_speed:.1f} m/min')
        parts.append(known.estimator)
    if math.isfinite(item.reference):
        parts.append(f'reference {GRAMS * item.reference:.2f} g')
    return ', '.join(parts)


def production(
    statistics: Statistics | None, filler: FillerFeedback | None
) -> list[tuple[str, str]]:
    """Return the counts of product and batch by name, and the correction of the filler."""
    if statistics is None:
        return [('', 'no statistics: the node product does not run')]
    known = statistics
    reasons = zip(known.reasons, known.reason_counts, strict=True)
    return [
        ('product', known.product or 'none'), ('batch', known.batch or 'none'),
        ('items', str(known.items)), ('accepted', str(known.accepted)),
        ('under', str(known.under)), ('over', str(known.over)), ('faults', str(known.faults)),
        *((name, str(count)) for name, count in reasons),
        ('net mean, g', grams(known.mean)), ('std dev, g', grams(known.std_dev)),
        ('giveaway, g', grams(known.giveaway)),
        ('below TU1', str(known.below_tu1)), ('below TU2', str(known.below_tu2)),
        ('items/min', number(known.throughput, 1)), *_correction(known, filler),
    ]  # fmt: skip


def _correction(known: Statistics, filler: FillerFeedback | None) -> list[tuple[str, str]]:
    if filler is None or filler.product != known.product:  # of the product before
        return []
    text = f'{GRAMS * filler.correction:+.3f}, at a median of {grams(filler.median)}'
    return [('filler correction, g', f'{text}; limited' if filler.limited else text)]


def batch_rules(statistics: Statistics | None, latest: Verdict | None) -> list[tuple[str, str]]:
    """Return the packers' rules for the batch on the line, each with how it stands.

    Parameters
    ----------
    statistics : Statistics or None
        Of the product in the batch, with the rules of its recipe.
    latest : Verdict or None
        The latest one, which has the counts of the rules.
    """
    known = statistics
    if known is None or not math.isfinite(known.nominal):
        return []
    tally = BatchTally() if latest is None else BatchTally.of(latest)
    if tally.key != (known.product, known.batch):  # nothing has passed yet
        tally = BatchTally(known.product, known.batch)
    return [
        ('net mean at least nominal', _mean_rule(known, tally)),
        (f'share below TU1, {grams(known.tu1)} g net', _tu1_rule(known, tally)),
        (f'none below TU2, {grams(known.tu2)} g net', _kept(not known.below_tu2)
         + f'{known.below_tu2} accepted'),
    ]  # fmt: skip


def _mean_rule(known: Statistics, tally: BatchTally) -> str:
    if not known.mean_value:
        return f'not asked by the recipe; the mean is {grams(known.mean)} g'
    if not tally.accepted:
        return 'nothing accepted yet'
    mean = known.nominal + tally.surplus / tally.accepted
    kept = _kept(mean >= known.nominal * (1 - ROUNDING))
    return f'{kept}{grams(mean)} g of {grams(known.nominal)} g; an item may lack ' + grams(
        max(tally.surplus, 0.0), ' g'
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


def grams(mass: float, unit: str = '', digits: int = 3) -> str:
    """Return a mass in kg as a number of grams."""
    return number(GRAMS * mass, digits, unit)


def number(value: float, digits: int, unit: str = '') -> str:
    """Return a number with a unit, a dash for one that is not known."""
    return f'{value:.{digits}f}{unit}' if math.isfinite(value) else '–'


def clock(stamp: int | None) -> str:
    """Return the time of a stamp on the clock of this machine."""
    if stamp is None:
        return '–'
    return f'{datetime.fromtimestamp(stamp / NANOSECONDS, UTC).astimezone():%H:%M:%S}'


def hint(reason: str) -> str:
    """Return what to check for a reason."""
    known = reason in Reason.__members__.values()
    return Reason(reason).hint if known else 'a reason that this version does not know'
