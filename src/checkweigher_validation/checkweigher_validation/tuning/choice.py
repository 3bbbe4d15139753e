# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The choice among tuned estimators, by passes that were held out of their tuning."""

from collections.abc import Mapping
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_validation.tuning.calibration import folds, index
from checkweigher_validation.tuning.tuner import Tuned

# Largest loss of a simpler estimator; A itself scatters by more between sets of 100 passes.
_NEGLIGIBLE = math.log(1.05)
_BLOCKS = 20  # of passes, left out in turn
_LEAST = 1e-12  # kg, least index, for passes without errors


def choose(tuned: Mapping[str, Tuned]) -> tuple[str, str]:
    """Choose the estimator with the smallest A on held-out passes, or an equally good simpler one.

    Returns its name, and the reason in one line.

    A is compared as a ratio, by the geometric mean over the belt speeds. A simpler estimator is
    equally good if the sum of its difference from the best and the standard error is negligible (a
    test of non-inferiority). With few passes no simpler one is, and the best is chosen. The
    standard error is computed by a jackknife over blocks of passes. Both estimators weigh the same
    passes, so that common disturbances cancel. [own derivation]

    Raises `ValueError` if there are no estimators.
    """
    names = sorted(tuned, key=lambda name: (*ESTIMATORS, name).index(name))
    logs = {name: _log_index(tuned[name], None) for name in names}
    best, *others = sorted(names, key=lambda name: logs[name])
    if not others:
        return best, f'{best}: nothing else was tuned'
    without = {name: _without_blocks(tuned[name]) for name in names}
    more = {name: logs[name] - logs[best] for name in others}
    # Standard errors by the jackknife, from the results without each block.
    errors = {
        name: float(np.std(without[name] - without[best]) * math.sqrt(len(without[name]) - 1))
        for name in others
    }
    losses = {name: f'{_percent(more[name])} +- {_percent(errors[name])}' for name in others}
    for name in names[: names.index(best)]:
        if more[name] + errors[name] <= _NEGLIGIBLE:
            why = f'simpler than {best}, whose A is smaller by next to nothing'
            return name, f'{name}: {why}, {losses[name]}'
    why = f'smallest A on held-out passes; that of {others[0]} is larger by'
    return best, f'{best}: {why} {losses[others[0]]}'


def _log_index(tuned: Tuned, block: int | None) -> float:
    """Return the mean over the speeds of ln A, without one block of the passes."""
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
