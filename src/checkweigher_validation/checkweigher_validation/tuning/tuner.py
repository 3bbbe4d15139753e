# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuning of estimators on passes of known mass."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress, product
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators import METHODS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.evaluating import weigh_passes
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.jobs import run_jobs
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
from checkweigher_validation.tuning.iswd_eksi import TunedIswdEksi
from checkweigher_validation.tuning.learned import TunedLearned
from checkweigher_validation.tuning.search import BUDGET
from checkweigher_validation.tuning.tunables import Tunable, TuningError, estimates_of

# Estimators that need a subclass of `Tunable`.
_OWN: dict[str, type[Tunable]] = {
    'iswd_eksi': TunedIswdEksi,
    'gauss_markov': TunedGaussMarkov,
    'learned': TunedLearned,
}
TUNABLES: dict[str, type[Tunable]] = {name: _OWN.get(name, Tunable) for name in METHODS}

UNTRAINED = 'untrained'  # name of the parameters before training, in comparisons
FEWEST_PASSES = 3  # smallest number of passes of one speed for tuning
_FEWEST_FOR_HALVES = 60  # smallest number of passes for cross-validation with halves or eighths
_FEWEST_FOR_FIFTHS = 20  # smallest number of passes for cross-validation with fifths
_CLOSED_FORM_FOLDS = 8  # number of folds for an estimator that is learned without a search
_DIGITS = 7  # significant digits of numbers in a parameter file


@dataclass(frozen=True, slots=True)
class TunedSpeed:
    """Tuning result of an estimator on the passes of one belt speed.

    Held-out errors are computed by cross-validation: each half of the passes is weighed with the
    parameters that are tuned on the other half. Eighths are used instead of halves if nothing is
    searched, fifths if there are fewer than 60 passes, and single passes if there are fewer than
    20. If `held_out_index` is much larger than `index`, the parameters are overfitted.
    `uncertainty` is computed from the held-out errors.
    """

    speed: float  # belt speed in m/s
    passes: int  # number of passes
    lists: Mapping[str, tuple[float, ...]]  # parameters for this speed; keys are ``node.name``
    calibration: Calibration  # gain and offset, fitted to all passes
    uncertainty: Uncertainty
    zero_std_dev: float  # median standard deviation of the zero in kg
    index: float  # overall index A on the training passes in kg
    masses: tuple[float, ...]  # true mass of each pass in kg, in order of entry
    held_out_index: float = math.nan  # A of the held-out errors in kg, NaN if not computed yet.
    # Error of each held-out pass in kg, in order of entry, or empty if not computed yet.
    held_out_errors: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Tuned:
    """Tuning results of an estimator at all speeds, and all parameters of the line."""

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
    """Tune estimators at each belt speed separately, in parallel.

    Parameters
    ----------
    groups : sequence of SpeedGroup
        Passes of known mass by belt speed.
    estimators : sequence of str
        Names of the estimators.
    base : LineParameters
        Start values of the tuned parameters, and values of all other parameters.
    budget : int
        Largest number of evaluations for each estimator at each speed, as in
        `checkweigher_validation.tuning.search.search`. For the held-out errors, each tuning without
        a fold of several passes has half of this budget.
    n_jobs : int, optional
        Number of processes, as in `checkweigher_validation.jobs.run_jobs`.
    skip_failing : bool
        Whether to omit estimators that cannot be tuned, unless all of them fail.

    Returns
    -------
    dict of str to Tuned
        Result of each estimator by name.

    Raises
    ------
    TuningError
        If there are no passes, or too few passes at a speed, or if an estimator cannot be tuned. If
        `skip_failing` is True, an estimator that cannot be tuned is an error only if all of them
        fail.
    """
    _check_passes(groups)
    prepare = {name: partial(TUNABLES[name].prepare, groups, base) for name in estimators}
    lines, failed = _run(prepare, n_jobs, 'preparing')
    # The jobs of all estimators are mixed, so that the finished jobs predict the remaining time.
    tasks = [
        TUNABLES[name](name, group, line, groups)
        for group, (name, line) in product(groups, lines.items())
    ]
    jobs = _jobs(tasks, budget)
    found, broken = _run(jobs, n_jobs, 'tuning', [_work(*each) for each in jobs])
    for (task, _), error in broken.items():
        failed.setdefault(task.name, error)
    may_fail = len(estimators) - 1 if skip_failing else 0
    if len(failed) > may_fail:
        raise next(iter(failed.values()))
    return {
        name: _assemble(
            name, [_with_held_out(task, found) for task in tasks if task.name == name], lines[name]
        )
        for name in estimators
        if name not in failed
    }


def untrained(groups: Sequence[SpeedGroup], base: LineParameters) -> Tuned:
    """Return the selected estimator of `base` without tuning, with its errors at each belt speed.

    The error of a pass without a mass is NaN. A at the speed of such a pass is also NaN. The fields
    `calibration` and `uncertainty` contain no values of `base`: the gain is 1, and the uncertainty
    is 0.
    """
    speeds = []
    for group in groups:
        masses = group.masses
        weighed = weigh_passes(group.passes, base)
        errors = np.array([each.mass for each in weighed]) - masses
        found = index(errors, masses)
        speeds.append(
            TunedSpeed(
                speed=group.speed,
                passes=len(masses),
                lists={},
                calibration=Calibration(1.0, 0.0),
                uncertainty=Uncertainty(0.0, 0.0),
                zero_std_dev=_zero_std_dev(group),
                index=found,
                masses=tuple(masses.tolist()),
                held_out_index=found,
                held_out_errors=tuple(errors.tolist()),
            )
        )
    return Tuned(base.identifier.estimator, tuple(speeds), base)


def _check_passes(groups: Sequence[SpeedGroup]) -> None:
    for group in groups:
        if len(group.passes) < FEWEST_PASSES:
            raise TuningError(
                f'{len(group.passes)} passes of known mass at {60 * group.speed:.1f} m/min are too '
                f'few; tuning needs at least {FEWEST_PASSES} passes at each speed'
            )
    if not groups:
        raise TuningError('there is no pass of known mass without a fault')


def _jobs(
    tasks: Sequence[Tunable], budget: int
) -> dict[tuple[Tunable, int | None], Callable[[], Any]]:
    """Return the jobs by task and fold. The fold is None for the tuning on all passes."""
    return {
        **{(task, None): partial(_tune_speed, task, budget) for task in tasks},
        **{
            (task, fold): partial(_check_fold, task, budget, fold)
            for fold in range(max((len(_folds(task)) for task in tasks), default=0))
            for task in tasks
            if fold in _folds(task)
        },
    }


def _run(
    jobs: Mapping[Any, Callable[[], Any]],
    n_jobs: int | None,
    text: str,
    sizes: Sequence[float] | None = None,
) -> tuple[dict[Any, Any], dict[Any, TuningError]]:
    """Run jobs, and return the results of successful jobs and the errors of the others, by key."""
    calls = [partial(_attempt, job) for job in jobs.values()]
    ended = list(zip(jobs, run_jobs(calls, n_jobs, text, sizes), strict=True))
    errors = {key: each for key, each in ended if isinstance(each, TuningError)}
    return {key: each for key, each in ended if key not in errors}, errors


def _attempt(job: Callable[[], Any]) -> Any:
    """Return the result of a job, or its TuningError, because an exception would end all jobs."""
    try:
        return job()
    except TuningError as error:
        return error


def _with_held_out(task: Tunable, found: Mapping[tuple[Tunable, int | None], Any]) -> TunedSpeed:
    """Return the result of the tuning on all passes, with the held-out errors of all folds."""
    masses = task.group.masses
    numbers = _folds(task)
    fold = folds(masses, len(numbers))
    errors = np.empty(len(masses))
    for number in numbers:
        errors[fold == number] = found[task, number]
    return replace(
        found[task, None],
        uncertainty=uncertainty(errors, masses),
        held_out_index=index(errors, masses),
        held_out_errors=tuple(errors.tolist()),
    )


def _folds(task: Tunable) -> range:
    """Return the numbers of the folds: halves, eighths, fifths, or single passes."""
    count = len(task.group.passes)
    if count >= _FEWEST_FOR_HALVES:
        return range(_CLOSED_FORM_FOLDS if task.is_closed_form else 2)
    return range(5 if count >= _FEWEST_FOR_FIFTHS else count)


def _is_halved(task: Tunable) -> bool:
    """Return whether a fold has half the budget, which limits the time for all folds."""
    return len(_folds(task)) < len(task.group.passes)


def _work(task: Tunable, fold: int | None) -> float:
    """Return the expected work of a job relative to other jobs of the same estimator."""
    count = len(task.group.passes)
    if fold is None:
        return count
    return count * (1 - 1 / len(_folds(task))) / (2 if _is_halved(task) else 1)


def _check_fold(task: Tunable, budget: int, fold: int) -> NDArray[np.float64]:
    """Tune on all passes except a fold, and return the errors of the fold, (n,) in kg."""
    group = task.group
    count = len(_folds(task))
    # Each fold has passes of each mass from the whole recording, and thus includes drifts.
    held_out = folds(group.masses, count) == fold
    learn, check = (
        replace(group, passes=tuple(compress(group.passes, chosen)))
        for chosen in (~held_out, held_out)
    )
    budget = max(budget // 2, 1) if _is_halved(task) else budget
    learned = _tune_speed(type(task)(task.name, learn, task.base, task.others), budget)
    estimates = estimates_of(check, _assemble(task.name, [learned], task.base).parameters)
    return learned.calibration.apply(estimates) - check.masses


def _tune_speed(tunable: Tunable, budget: int) -> TunedSpeed:
    group, masses = tunable.group, tunable.group.masses
    values, badness = tunable.search(
        lambda values: calibrated_index(tunable.estimates(values), masses), budget
    )
    if not math.isfinite(badness):
        raise TuningError(
            f'{tunable.name} finds no mass in some of the {len(masses)} passes at '
            f'{60 * group.speed:.1f} m/min, with all parameters that were tried'
        )
    estimates = tunable.estimates(values)
    return TunedSpeed(
        speed=group.speed,
        passes=len(masses),
        lists=tunable.lists(values),
        calibration=calibrate(estimates, masses),
        uncertainty=uncertainty(held_out_errors(estimates, masses), masses),
        zero_std_dev=_zero_std_dev(group),
        index=badness,
        masses=tuple(masses.tolist()),
    )


def _zero_std_dev(group: SpeedGroup) -> float:
    zero = [abs(each.window.zero_std_dev / each.window.counts_per_kg) for each in group.passes]
    return float(np.median(zero))


def _assemble(estimator: str, speeds: Sequence[TunedSpeed], base: LineParameters) -> Tuned:
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
            f'{own}.lightest_mass': (min(each.masses),),
            f'{own}.heaviest_mass': (max(each.masses),),
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
