# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The choice among tuned estimators, by passes that were held out from all of them alike."""

from collections.abc import Mapping
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_validation.tuning.calibration import folds, index
from checkweigher_validation.tuning.tuner import Tuned

# The fewer numbers of an estimator are learned, the earlier it stands.
SIMPLEST_FIRST = (
    'mean', 'hann', 'iswd_eksi_paper', 'tvlpf', 'aid', 'aeksi', 'iswd_eksi', 'fir_model',
    'gauss_markov', 'learned',
)  # fmt: skip
# What a simpler estimator may lose: less than A itself scatters from one 100 passes to the next.
_NEGLIGIBLE = math.log(1.05)
_BLOCKS = 20  # of passes, left out in turn
_LEAST = 1e-12  # kg, of an index without errors


@dataclass(frozen=True, slots=True)
class Choice:
    """The estimator that is to weigh, and the reason in one line."""

    estimator: str
    reason: str


def choose(tuned: Mapping[str, Tuned]) -> Choice:
    """Choose the estimator of the smallest A on held-out passes, or a simpler one as good.

    A is compared as a ratio, in the geometric mean over the belt speeds. A simpler estimator is as
    good where the passes show that it loses next to nothing: the difference from the best and its
    standard error together are negligible (a test of non-inferiority). Few passes show that of
    none, and then the best of them is the best guess. The standard error is that of a jackknife
    over blocks of passes: the same passes for both, so that what disturbs both alike does not
    count. [own derivation]

    Raises
    ------
    ValueError
        If there is nothing to choose from.
    """
    names = sorted(tuned, key=lambda name: (*SIMPLEST_FIRST, name).index(name))
    logs = {name: _log_index(tuned[name], None) for name in names}
    best = min(names, key=lambda name: logs[name])
    others = [name for name in names if name != best]
    if not others:
        return Choice(best, f'{best}: nothing else was tuned')
    without = {name: _without_blocks(tuned[name]) for name in names}
    second = min(others, key=lambda name: logs[name])
    for name in others[: names.index(best)]:
        more, error = logs[name] - logs[best], _standard_error(without[name] - without[best])
        if more + error <= _NEGLIGIBLE:
            why = f'simpler than {best}, whose A is smaller by next to nothing'
            return Choice(name, f'{name}: {why}, {_percent(more)} +- {_percent(error)}')
    more, error = logs[second] - logs[best], _standard_error(without[second] - without[best])
    why = f'smallest A on held-out passes; that of {second} is larger by'
    return Choice(best, f'{best}: {why} {_percent(more)} +- {_percent(error)}')


def _log_index(tuned: Tuned, block: int | None) -> float:
    """Return the mean over the speeds of ln A, all passes but one block of them."""
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


def _standard_error(values: NDArray[np.float64]) -> float:
    """Return the standard error of a jackknife, from what is left without each block."""
    return float(np.std(values) * math.sqrt(len(values) - 1))


def _percent(log_ratio: float) -> str:
    return f'{100 * math.expm1(log_ratio):.0f} %'
