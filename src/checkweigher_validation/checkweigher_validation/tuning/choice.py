# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Choice among tuned estimators by their errors on passes that were not used for tuning.

The default parameters without training are a candidate as well, so that a tuned estimator is chosen
only if it is better than the default.
"""

from collections.abc import Mapping, Sequence
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.calibration import folds, index
from checkweigher_validation.tuning.tuner import UNTRAINED, Tuned, untrained

# Estimators with at most one searched coefficient, which few passes can determine. Other estimators
# need a search of minutes, and have a larger A than `learned` on random machines; see
# docs/accuracy.md.
CANDIDATES = ('mean', 'hann', 'fir_model', 'learned')
# Largest increase of ln A that is negligible. Between sets of 100 passes, ln A varies by more than
# this increase.
_NEGLIGIBLE = math.log(1.05)
_BLOCKS = 20  # number of blocks of passes for the jackknife
_LEAST = 1e-12  # smallest A in kg, to avoid the logarithm of 0


def with_untrained(
    tuned: Mapping[str, Tuned], groups: Sequence[SpeedGroup], base: LineParameters
) -> dict[str, Tuned]:
    """Return `tuned`, with untrained `base` as the first entry if it weighs all passes.

    `groups` contains the training passes, cut with the parameters `base`. Untrained `base` is also
    omitted if, at a speed, the numbers of passes in `groups` and in the result of a tuned estimator
    differ.
    """
    default = untrained(groups, base)
    weighed = all(np.all(np.isfinite(speed.held_out_errors)) for speed in default.speeds)
    counts = {
        tuple(len(speed.masses) for speed in each.speeds) for each in (default, *tuned.values())
    }
    return {**({UNTRAINED: default} if weighed and len(counts) == 1 else {}), **tuned}


def choose(tuned: Mapping[str, Tuned]) -> tuple[str, str]:
    """Return the name of the chosen estimator, and the reason for the choice in one line.

    The best estimator has the smallest A on held-out passes, as a geometric mean over the belt
    speeds. An estimator is simpler than the best one if it precedes the best one in `ESTIMATORS`. A
    simpler estimator is chosen instead if the increase of ln A plus one standard error of the
    increase is negligible. This rule is not a significance test: in about one of six choices of a
    simpler estimator, the increase is not negligible. The standard error is computed by a jackknife
    over blocks of passes. With few passes, the standard error is so large that no simpler tuned
    estimator is chosen. Disturbances cancel in the increase, because both estimators weigh the same
    passes. The parameters without training, if `tuned` contains them, count as the simplest
    estimator. The parameters without training are also chosen if the increase of ln A is at most
    one standard error. [own derivation]

    Raises `ValueError` if `tuned` is empty.
    """
    names = sorted(tuned, key=lambda name: (UNTRAINED, *ESTIMATORS, name).index(name))
    logs = {name: _log_index(tuned[name], None) for name in names}
    best, *others = sorted(names, key=lambda name: logs[name])
    if not others:
        return best, f'{best}: nothing else was tuned'
    without = {name: _without_blocks(tuned[name]) for name in names}
    more = {name: logs[name] - logs[best] for name in others}
    # Standard errors from the results without each block, by the formula of the jackknife.
    errors = {
        name: float(np.std(without[name] - without[best]) * math.sqrt(len(without[name]) - 1))
        for name in others
    }
    losses = {name: f'{_percent(more[name])} +- {_percent(errors[name])}' for name in others}
    if UNTRAINED in others and more[UNTRAINED] <= errors[UNTRAINED]:
        why = f'no tuned estimator is clearly better; its A is larger than that of {best} by'
        return UNTRAINED, f'{UNTRAINED}: {why} {losses[UNTRAINED]}'
    for name in names[: names.index(best)]:
        if more[name] + errors[name] <= _NEGLIGIBLE:
            why = f'simpler than {best}, whose A is smaller by a negligible amount'
            return name, f'{name}: {why}, {losses[name]}'
    why = f'smallest A on held-out passes; that of {others[0]} is larger by'
    return best, f'{best}: {why} {losses[others[0]]}'


def _log_index(tuned: Tuned, block: int | None) -> float:
    """Return the mean of ln A over the speeds. If `block` is given, its passes are omitted."""
    logs = []
    for speed in tuned.speeds:
        errors, masses = np.array(speed.held_out_errors), np.array(speed.masses)
        if block is not None:
            kept = folds(masses, _BLOCKS) != block
            errors, masses = errors[kept], masses[kept]
        logs.append(math.log(max(index(errors, masses), _LEAST)))
    return float(np.mean(logs))


def _without_blocks(tuned: Tuned) -> NDArray[np.float64]:
    blocks = min(_BLOCKS, *(len(speed.masses) for speed in tuned.speeds))
    return np.array([_log_index(tuned, block) for block in range(blocks)])


def _percent(log_ratio: float) -> str:
    return f'{100 * math.expm1(log_ratio):.0f} %'
