# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Table of the accuracy of estimators, with a row per estimator and a column per belt speed."""

from collections.abc import Sequence
import math
from typing import NamedTuple

from checkweigher_core.records import GRAMS
from checkweigher_validation.tuning.tuner import UNTRAINED
from checkweigher_web.languages.language import ENGLISH, Language

_CHOSEN = 'chosen: '


class Matrix(NamedTuple):
    """Table of the accuracy on held-out passes, and lines of text on the effect of training."""

    heads: tuple[str, ...]
    # The row of the chosen estimator is first, followed by the rows of the other estimators, the
    # most accurate first.
    rows: tuple[tuple[str, ...], ...]
    changes: tuple[str, ...]


def matrix_of(lines: Sequence[str], say: Language = ENGLISH) -> Matrix:
    """Return the matrix for the lines that `accuracy_lines` returns for a parameter file.

    Without lines, the matrix has only the heading of its first column.
    """
    found: dict[str, dict[str, float]] = {}
    chosen, reason = '', ''
    for line in lines[1:]:
        if line.startswith(_CHOSEN):
            chosen, _, reason = line.removeprefix(_CHOSEN).partition(': ')
            continue
        name, speed, _, _, held_out = line.split()
        found.setdefault(name, {})[speed] = float(held_out)
    speeds = tuple(dict.fromkeys(speed for row in found.values() for speed in row))
    names = sorted(found, key=lambda name: (name != chosen, _mean(found[name])))
    heads = (say('estimator'), *(f'{speed} m/min' for speed in speeds))
    rows = tuple(
        (_words(name, say), *(say.mass(found[name].get(s, math.nan) / GRAMS) for s in speeds))
        for name in names
    )
    return Matrix(heads, rows, _changes(found, names, chosen, reason, say))


def _mean(by_speed: dict[str, float]) -> float:
    return math.fsum(by_speed.values()) / len(by_speed)


def _words(name: str, say: Language) -> str:
    return say('as now, without training') if name == UNTRAINED else name


def _changes(
    found: dict[str, dict[str, float]],
    names: Sequence[str],
    chosen: str,
    reason: str,
    say: Language,
) -> tuple[str, ...]:
    """Return lines with the accuracy now and after training, and a line on the best estimator.

    There is a line for each speed at which both accuracies are known. The best estimator is the
    chosen one, or the most accurate one if none is chosen. If training does not improve the
    accuracy clearly, a single line states this. Returns () if there are no estimators.
    """
    if not names:
        return ()
    best = names[0]
    if chosen == UNTRAINED:
        return (say('Training would make nothing clearly better: keep what the line has.'),)
    now = found.get(UNTRAINED, {})
    lines = [
        say(
            '{speed} m/min: {now} now → {then}',
            speed=speed,
            now=say.mass(now[speed] / GRAMS),
            then=say.mass(value / GRAMS),
        )
        for speed, value in found[best].items()
        if speed in now
    ]
    if reason:
        return (*lines, say('Best: {name}; {reason}', name=best, reason=reason))
    return (*lines, say('Trained: {name}', name=best))
