# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the production counts and of the packers' rules for the batch (76/211/EEC)."""

import math
import time

from nicegui import json
import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import GRAMS, NANOSECONDS, FillerFeedback, Statistics, Verdict
from checkweigher_dsp.rejection.batch_rules import ROUNDING, BatchTally
from checkweigher_web.elements import Production, Table
from checkweigher_web.history import HOUR, History, intervals
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.views.view import View

_INTERVALS, _MINUTE = 60, 60 * NANOSECONDS
# Used fraction of the margin that is returned for a broken rule without a margin.
_FULL = 2.0
# Name and state of a rule, and the used fraction of its margin. The fraction is None if the recipe
# does not ask for the rule, or if the rule needs the mean of accepted items and there are none.
Rule = tuple[str, str, float | None]


class ProductionView(View):
    """Counts of the product and the batch, and the state of the packers' rules."""

    title = Text('Production')
    columns = 1, 5

    def _build(self) -> None:
        self._figures = Production()
        self._counts = Table((self.say('what'), self.say('value')))

    def _state(self) -> object:
        return super()._state() if self.look.board is None else int(time.monotonic())

    def _show(self) -> None:
        known, live = self.lane.statistics, self.look.board is not None
        text = self.drawing.once(
            ('production', self.say), self._state(), lambda: self._draw(live=live)
        )
        self._figures.show_text(text)
        self._counts.show(production(known, self.lane.filler, self.say))

    def _draw(self, *, live: bool) -> str:
        known, item = self.lane.statistics, self.drawing.latest()
        history = self.lane.history()
        last = int(history.stamps[-1]) if len(history.stamps) else 0
        # On a running line the last minute ends now, so that the rate falls to 0 if nothing passes.
        now = time.time_ns() if live and 0 <= time.time_ns() - last < HOUR else last
        rules = batch_rules(known, None if item is None else item.verdict, self.say)
        return json.dumps({'figures': figures(history, known, now, self.say), 'rules': rules})


def figures(
    history: History, known: Statistics | None, now: int, say: Language = ENGLISH
) -> list[tuple[str, str, str]]:
    """Return the main figures, each with its name, its value as text, and the points of a chart.

    The chart covers the last hour before `now` in ns, or the time since the first item if that is
    less than an hour, but at least 1 min. The time axis is divided into intervals, and the chart
    has a point for each interval with a value. The points are in SVG format, in a frame of 100 by
    30.
    """
    since = int(history.stamps[0]) if len(history.stamps) else now
    length = min(max(now - since, _MINUTE), HOUR)
    course = intervals(history, now - length, now, min(_INTERVALS, 6 * length // _MINUTE))
    passed = np.count_nonzero((now - _MINUTE < history.stamps) & (history.stamps <= now))
    target = math.nan if known is None else GRAMS * (known.nominal + known.tare)
    # Time in min over which `passed` is counted, which is below 1 in the first minute.
    share = max(min((now - since) / _MINUTE, 1.0), 1 / 60)
    giveaway, mean = course.means - target, course.means - (known.tare * GRAMS if known else 0)
    rejects = 1.0 - known.accepted / known.items if known and known.items else math.nan
    return [
        (say('items/min, last minute'), say.number(passed / share, 0), _points(course.rates)),
        (say('rejected'), say.number(100 * rejects, 1, ' %'), _points(course.rejects)),
        (say('giveaway'), say.mass(known.giveaway if known else math.nan, 2), _points(giveaway)),
        (say('net mean'), say.mass(known.mean if known else math.nan, 2), _points(mean)),
    ]


def _points(values: NDArray[np.float64]) -> str:
    known = np.flatnonzero(np.isfinite(values))
    low, high = (float(f(values[known])) for f in (np.min, np.max)) if len(known) else (0.0, 0.0)
    height = (values - low) / (high - low) if high > low else np.full(len(values), 0.5)
    return ' '.join(f'{100 * k / (len(values) - 1):.1f},{29 - 28 * height[k]:.1f}' for k in known)


def production(
    known: Statistics | None, filler: FillerFeedback | None, say: Language = ENGLISH
) -> list[tuple[str, str]]:
    """Return rows with the counts of the product and the batch, and the filler correction.

    Without statistics, a single row states that there are none. There is no row for the filler
    correction if none has arrived for this product.
    """
    if known is None:
        return [('', say('no statistics: the node product does not run'))]
    counts = {
        say('product'): known.product or say('none'),
        say('batch'): known.batch or say('none'),
        say('items'): known.items,
        say('accepted'): known.accepted,
        say('below the limits'): known.under,
        say('above the limits'): known.over,
        say('faults'): known.faults,
        **dict(zip(known.reasons, known.reason_counts, strict=True)),
        say('net mean, {unit}', unit=say.unit): say.amount(known.mean),
        say('std dev, {unit}', unit=say.unit): say.amount(known.std_dev),
        say('giveaway, {unit}', unit=say.unit): say.amount(known.giveaway),
        say('below TU1'): known.below_tu1,
        say('below TU2'): known.below_tu2,
        say('items/min'): say.number(known.throughput, 1),
    }
    shown = [(name, str(value)) for name, value in counts.items()]
    return [*shown, *_correction(known, filler, say)]


def _correction(
    known: Statistics, filler: FillerFeedback | None, say: Language
) -> list[tuple[str, str]]:
    if filler is None or filler.product != known.product:
        return []
    text = say(
        '{correction}, at a median of {median}',
        correction=say.amount(filler.correction, sign='+'),
        median=say.amount(filler.median),
    )
    shown = say('{correction}; limited', correction=text) if filler.limited else text
    return [(say('filler correction, {unit}', unit=say.unit), shown)]


def batch_rules(
    known: Statistics | None, latest: Verdict | None, say: Language = ENGLISH
) -> list[Rule]:
    """Return the state of each packers' rule for the present batch.

    The statistics in `known` contain the rules of the recipe, and the `latest` verdict contains the
    counts on which the rules depend. Returns [] without statistics or without a nominal mass.
    """
    if known is None or not math.isfinite(known.nominal):
        return []
    tally = BatchTally() if latest is None else BatchTally.of(latest)
    if tally.key != (known.product, known.batch):  # No item of this batch has a verdict yet.
        tally = BatchTally(known.product, known.batch)
    none_below = say('{count} accepted', count=known.below_tu2)
    return [
        (say('net mean at least nominal'), *_mean_rule(known, tally, say)),
        (
            say('share below TU1, {mass} net', mass=say.mass(known.tu1)),
            *_tu1_rule(known, tally, say),
        ),
        (
            say('none below TU2, {mass} net', mass=say.mass(known.tu2)),
            _kept(not known.below_tu2) + none_below,
            _FULL * bool(known.below_tu2),
        ),
    ]


def _mean_rule(known: Statistics, tally: BatchTally, say: Language) -> tuple[str, float | None]:
    if not known.mean_value:
        text = say('not asked by the recipe; the mean is {mass}', mass=say.mass(known.mean))
        return text, None
    if not tally.accepted:
        return say('nothing accepted yet'), None
    mean = known.nominal + tally.surplus / tally.accepted
    # The margin is used up if the mean is equal to the nominal mass, and unused if the mean exceeds
    # the nominal mass by nominal - TU1 or more.
    used = max(1.0 - (mean - known.nominal) / (known.nominal - known.tu1), 0.0)
    text = say(
        '{mean} of {nominal}; an item may lack {surplus}',
        mean=say.mass(mean),
        nominal=say.mass(known.nominal),
        surplus=say.mass(max(tally.surplus, 0.0)),
    )
    return _kept(mean >= known.nominal * (1 - ROUNDING)) + text, used


def _tu1_rule(known: Statistics, tally: BatchTally, say: Language) -> tuple[str, float | None]:
    quota = known.tu1_quota
    if not math.isfinite(quota):
        text = say(
            'not asked by the recipe; {count} accepted, {share}',
            count=known.below_tu1,
            share=say.number(100 * known.share_below_tu1, 2, ' %'),
        )
        return text, None
    share = tally.below_tu1 / tally.accepted if tally.accepted else 0.0
    text = say(
        '{below} of {accepted} accepted, {share} of at most {quota}; {next}',
        below=tally.below_tu1,
        accepted=tally.accepted,
        share=say.number(100 * share, 2, ' %'),
        quota=f'{say.entry(100 * quota)} %',
        next=Text('the next one is accepted')
        if tally.has_room(quota)
        else Text('the next one is rejected, TU1Quota'),
    )
    used = share / quota if quota else _FULL * (share > 0)
    return _kept(share <= quota * (1 + ROUNDING)) + text, used


def _kept(kept: bool) -> str:
    return '✓ ' if kept else '✗ '
