# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Findings on learning from products of unknown mass, and on changes of the machine."""

import math
from statistics import median

import numpy as np

from checkweigher_core.health.findings import Concern, Finding, Level, Values, conclude, warn_if
from checkweigher_core.printable import counted
from checkweigher_core.records import GRAMS
from checkweigher_dsp.estimation.learning.change import strongest_frequency
from checkweigher_dsp.estimation.learning.learner import ItemKind, LearnedKinds, LearningParameters

_HINT = 'check what was changed (belt, rollers, feet), then call forget_learned to learn again'
_QUARTERS = (0.25, 0.5, 0.75, 1.0)


def learning_finding(
    known: LearnedKinds, parameters: LearningParameters, *, on: bool, trouble: str = ''
) -> Finding:
    """Return the finding on the learned state (aspect Learning).

    `on` is true if learning is switched on. `trouble` is the reason why the learned state is not
    stored, or empty.
    """
    if not on:
        return Finding('Learning', Level.OK, 'off')
    concerns = [
        *(
            Concern(
                Level.WARN, f'{_name(kind)}: since item {kind.change.item_id} {kind.change}', _HINT
            )
            for kind in known.kinds
            if kind.change is not None
        ),
        warn_if(bool(trouble), f'the learned state is not stored: {trouble}', 'check the file'),
    ]
    values: Values = {_name(kind): describe(kind) for kind in known.kinds}
    weighing = sum(kind.weighs for kind in known.kinds)
    text = f'{weighing} of {len(known.kinds)} speeds and lengths are weighed by learned weights'
    if not weighing:
        most = max((kind.items for kind in known.kinds), default=0)
        text = f'{counted(most, "item")} at one speed and length, {parameters.fewest} are needed'
    return conclude('Learning', text, concerns, values)


def describe(kind: ItemKind) -> str:
    """Return a description of the learned state for one belt speed and product length."""
    text = counted(kind.items, 'item')
    taught = kind.fit
    if taught is None:
        return text if kind.change is None else f'{text}; {kind.change}'
    before, after = (GRAMS * math.sqrt(each) for each in (taught.variance_before, taught.variance))
    entered = taught.lead + kind.rise
    rise = taught.curve[taught.lead : entered]
    level = float(np.mean(taught.curve[entered:]))
    shares = ' '.join(
        f'{np.interp(quarter * len(rise), np.arange(len(rise)) + 0.5, rise) / level:.3f}'
        for quarter in _QUARTERS
    )
    spans = (slice(0, taught.lead), slice(taught.lead, entered), slice(entered, None))
    noise = ', '.join(
        f'{GRAMS * math.sqrt(float(np.mean(np.square(taught.noise[span])))):.2g}'
        for span in spans
        if len(taught.noise[span])
    )
    frequency = strongest_frequency(taught, _duration(kind))
    state = 'weighs' if kind.weighs else 'does not weigh'
    return (
        f'{text}, {state}; standard deviation of held-out items {after:.3g} g, with the estimator '
        f'{before:.3g} g; load at the quarters of t1..t2 {shares} of the final load; noise before '
        f't1, from t1 to t2, and from t2 to t3 {noise} g; strongest frequency {frequency:.1f} Hz'
    )


def _duration(kind: ItemKind) -> float:
    known = [each.duration for each in kind.passages]
    return median(known) if known else kind.length / kind.speed / kind.rise


def _name(kind: ItemKind) -> str:
    return f'{kind.speed:.3f} m/s, {GRAMS * kind.length:.0f} mm'
