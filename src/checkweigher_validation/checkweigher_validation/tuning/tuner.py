# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuning: from passes of known mass to parameters, for each estimator by the same procedure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.jobs import run_jobs
from checkweigher_validation.tuning import tunables
from checkweigher_validation.tuning.calibration import (
    Calibration,
    Uncertainty,
    calibrate,
    calibrated_index,
    folds,
    held_out_errors,
    index,
    uncertainty,
)
from checkweigher_validation.tuning.gauss_markov import TunedGaussMarkov
from checkweigher_validation.tuning.learned import TunedLearned
from checkweigher_validation.tuning.search import BUDGET
from checkweigher_validation.tuning.tunables import Tunable, TuningError, estimates_of

TUNABLES: dict[str, type[Tunable]] = {
    tunable.name: tunable
    for tunable in (
        tunables.TunedMean, tunables.TunedHann, tunables.TunedTvlpf, tunables.TunedAid,
        tunables.TunedAeksi, tunables.TunedIswdEksi, tunables.TunedFirModel, TunedGaussMarkov,
        TunedLearned, tunables.TunedIswdEksiPaper,
    )
}  # fmt: skip

FEWEST_PASSES = 3  # of one speed; fewer tell nothing of their own scatter
_FEWEST_FOR_HALVES = 60  # each half then holds enough to be tuned on
_FEWEST_FOR_FIFTHS = 20
_DIGITS = 7  # significant, of what is written into a parameter file


@dataclass(frozen=True, slots=True)
class TunedSpeed:
    """Parameters, calibration and accuracy from the passes of one belt speed.

    `lists` has the values of the lists of parameters for this speed, by their name with that of the
    node. `held_out_index` is A when each half of the passes (of fewer than 60 each fifth, of fewer
    than 20 each single one) is weighed by what the others taught; much more than `index` means
    overfitting. `uncertainty` is that of passes held out of the calibration; with fewer than 60
    passes it is that of `held_out_errors`.
    """

    speed: float  # m/s
    passes: int
    lists: Mapping[str, tuple[float, ...]]
    calibration: Calibration
    uncertainty: Uncertainty
    zero_std_dev: float  # kg, typical of these passes
    index: float  # A on the training passes, kg
    held_out_index: float = math.nan  # kg
    # Of the same passes: (n,), kg, in the same order for every estimator.
    held_out_errors: tuple[float, ...] = ()
    masses: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Tuned:
    """An estimator that is tuned at all speeds, and the parameters of the line that follow."""

    estimator: str
    speeds: tuple[TunedSpeed, ...]
    parameters: LineParameters


def tune(
    groups: Sequence[SpeedGroup],
    estimators: Sequence[str],
    base: LineParameters,
    *,
    budget: int = BUDGET,
    n_jobs: int | None = None,
    skip_failing: bool = False,
) -> dict[str, Tuned]:
    """Tune estimators, each belt speed for itself and the speeds side by side.

    Parameters
    ----------
    groups : sequence of SpeedGroup
        Passes of known mass by belt speed.
    estimators : sequence of str
        Names.
    base : LineParameters
        Everything that is not tuned.
    budget : int
        Evaluations of each estimator at each speed, at most.
    n_jobs : int, optional
        Processes, as in `checkweigher_validation.jobs.run_jobs`.
    skip_failing : bool
        Whether an estimator that fails is left out, as long as any is tuned.

    Returns
    -------
    dict of str to Tuned
        By estimator.

    Raises
    ------
    TuningError
        If there are too few passes at a speed, or an estimator fails on them with all values.
    """
    for group in groups:
        if len(group.passes) < FEWEST_PASSES:
            raise TuningError(
                f'{len(group.passes)} passes of known mass at {60 * group.speed:.1f} m/min, tuning '
                f'takes at least {FEWEST_PASSES} at each speed'
            )
    if not groups:
        raise TuningError('no whole pass of known mass')
    others = [tuple(other for other in groups if other is not group) for group in groups]
    calls = [partial(_attempt, TUNABLES[name].prepare, groups, base) for name in estimators]
    prepared = run_jobs(calls, n_jobs, 'preparing')
    tasks = [
        _Task(name, group, line, budget, rest)
        for name, line in zip(estimators, prepared, strict=True)
        if not isinstance(line, TuningError)
        for group, rest in zip(groups, others, strict=True)
    ]
    calls = [partial(_attempt, _tune_speed, task) for task in tasks]
    calls += [partial(_attempt, _check_fold, task, n) for task in tasks for n in _folds(task.group)]
    found = run_jobs(calls, n_jobs, 'tuning')
    failed = [each for each in (*prepared, *found) if isinstance(each, TuningError)]
    if failed and not skip_failing:
        raise failed[0]
    held_out = iter(found[len(tasks) :])
    tuned: dict[str, list[TunedSpeed]] = {}
    for task, learned in zip(tasks, found[: len(tasks)], strict=True):
        checks = [next(held_out) for _ in _folds(task.group)]
        if not any(isinstance(each, TuningError) for each in (learned, *checks)):
            tuned.setdefault(task.estimator, []).append(_with_held_out(learned, checks))
    whole = {task.estimator: task.base for task in tasks}
    result = {
        name: _assemble(name, speeds, whole[name])
        for name, speeds in tuned.items()
        if len(speeds) == len(groups)
    }
    if not result:
        raise failed[0]
    return result


@dataclass(frozen=True, slots=True)
class _Task:
    """What is tuned on what: an estimator on the passes of one speed."""

    estimator: str
    group: SpeedGroup
    base: LineParameters
    budget: int
    others: tuple[SpeedGroup, ...]


def _attempt(call: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a call returns, or its TuningError: a job that raises would end the others."""
    try:
        return call(*arguments)
    except TuningError as error:
        return error


def _with_held_out(learned: TunedSpeed, checks: Sequence[NDArray[np.float64]]) -> TunedSpeed:
    errors, masses = np.concatenate(checks, axis=1)
    learned = replace(
        learned, held_out_index=index(errors, masses), held_out_errors=tuple(errors.tolist()),
        masses=tuple(masses.tolist()),
    )  # fmt: skip
    if len(masses) < _FEWEST_FOR_HALVES:
        # A search fits few passes far better than those to come.
        learned = replace(learned, uncertainty=uncertainty(errors, masses))
    return learned


def _folds(group: SpeedGroup) -> range:
    """Return the numbers of the folds: halves, fifths, or every single pass where there are few."""
    count = len(group.passes)
    if count >= _FEWEST_FOR_HALVES:
        return range(2)
    return range(5 if count >= _FEWEST_FOR_FIFTHS else count)


def _check_fold(task: _Task, fold: int) -> NDArray[np.float64]:
    """Tune on all passes of a speed but a fold, and return its errors and masses, (2, n), kg."""
    group, budget = task.group, task.budget
    count = len(_folds(group))
    # In turn, so that a drift and every mass are in both halves.
    held_out = folds(group.masses, count) == fold
    learn, check = (
        replace(group, passes=tuple(compress(group.passes, chosen)))
        for chosen in (~held_out, held_out)
    )
    # Half the passes, half the evaluations: the check costs as much as what it checks.
    budget = max(budget // 2, 1) if count < len(group.passes) else budget
    learned = _tune_speed(replace(task, group=learn, budget=budget))
    parameters = _assemble(task.estimator, [learned], task.base).parameters
    estimates = estimates_of(check, parameters)
    return np.stack((learned.calibration.apply(estimates) - check.masses, check.masses))


def _tune_speed(task: _Task) -> TunedSpeed:
    estimator, group, budget = task.estimator, task.group, task.budget
    tunable = TUNABLES[estimator](group, task.base, task.others)
    masses = group.masses
    values, badness = tunable.search(
        lambda values: calibrated_index(tunable.estimates(values), masses), budget
    )
    if not math.isfinite(badness):
        raise TuningError(
            f'{estimator} finds no mass in some of the {len(masses)} passes at '
            f'{60 * group.speed:.1f} m/min, with all parameters that were tried'
        )
    estimates = tunable.estimates(values)
    zero = [abs(each.window.zero_std_dev / each.window.counts_per_kg) for each in group.passes]
    return TunedSpeed(
        speed=group.speed,
        passes=len(masses),
        lists=tunable.lists(values),
        calibration=calibrate(estimates, masses),
        uncertainty=uncertainty(held_out_errors(estimates, masses), masses),
        zero_std_dev=float(np.median(zero)),
        index=badness,
    )


def _assemble(estimator: str, speeds: Sequence[TunedSpeed], base: LineParameters) -> Tuned:
    """Put the values of all speeds into the parameters of the line."""
    own = f'identifier.{estimator}'
    lists: dict[str, tuple[float, ...]] = {}
    for each in speeds:
        values = {
            f'{own}.speeds': (each.speed,),
            f'{own}.gain': (each.calibration.gain,),
            f'{own}.offset': (each.calibration.offset,),
            f'{own}.std_dev': (each.uncertainty.std_dev,),
            f'{own}.relative_std_dev': (each.uncertainty.relative,),
            f'{own}.zero_std_dev': (each.zero_std_dev,),
            **each.lists,
            **{f'{name.rpartition(".")[0]}.speeds': (each.speed,) for name in each.lists},
        }
        for name, value in values.items():
            lists[name] = lists.get(name, ()) + tuple(float(f'{x:.{_DIGITS}g}') for x in value)
    training = (f'{each.passes} passes at {60 * each.speed:.1f} m/min' for each in speeds)
    changes: dict[str, object] = {
        **lists,
        f'{own}.calibrated': True,
        f'{own}.training': ', '.join(training),
        'identifier.estimator': estimator,
    }
    if f'{own}.reflection' in lists:
        changes[f'{own}.order'] = len(lists[f'{own}.reflection']) // len(speeds)
    return Tuned(estimator, tuple(speeds), base.with_values(changes))
