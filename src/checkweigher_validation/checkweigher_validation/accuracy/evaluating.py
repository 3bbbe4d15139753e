# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of estimators on passes of known mass."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
import math

import numpy as np

from checkweigher_core.records import MassEstimate
from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.estimation.identifier import Identifier
from checkweigher_dsp.pipeline.line import LineParameters, estimate_masses
from checkweigher_validation.accuracy.errors import ConditionResult
from checkweigher_validation.accuracy.passes import KnownPass
from checkweigher_validation.jobs import run_jobs

_MASS_STEP = 1e-6  # smallest difference of true masses that is not ignored, in kg


@dataclass(frozen=True, slots=True)
class PassSet:
    """Passes of one nominal speed and one part, including passes that cannot be weighed."""

    speed: float  # m/s
    part: str  # 'train' or 'test'
    passes: tuple[KnownPass, ...]
    bounds: Mapping[float, float] = field(default_factory=dict)  # Gauss-Markov bounds by mass in kg


def weigh_passes(passes: Iterable[KnownPass], parameters: LineParameters) -> list[MassEstimate]:
    """Return the estimate for each pass after denoising."""
    windows = [each.window for each in passes]
    return estimate_masses(windows, Denoiser(parameters.denoise), Identifier(parameters.identifier))


def evaluate_set(known: PassSet, parameters: LineParameters) -> list[ConditionResult]:
    """Return the results of the selected estimator at each mass of a set."""
    estimates = weigh_passes(known.passes, parameters)
    masses = np.array([each.mass for each in known.passes])
    keys = np.round(masses / _MASS_STEP)
    results = []
    for key in np.unique(keys):
        chosen = np.flatnonzero(keys == key)
        weighed = [number for number in chosen if estimates[number].weighed]
        mass = float(masses[chosen[0]])
        result = ConditionResult(
            parameters.identifier.estimator,
            known.speed,
            mass,
            known.part,
            errors=np.array([estimates[number].mass - masses[number] for number in weighed]),
            std_devs=np.array([estimates[number].std_dev for number in weighed]),
            faults=len(chosen) - len(weighed),
            bound=known.bounds.get(mass, math.nan),
        )
        results.append(result)
    return results


def evaluate_sets(
    sets: Sequence[PassSet], estimators: Sequence[LineParameters], n_jobs: int | None = None
) -> tuple[ConditionResult, ...]:
    """Return the results of estimators on sets, in the order of the estimators.

    `estimators` has parameters that select different estimators. `n_jobs` is the number of
    processes as in `checkweigher_validation.jobs.run_jobs`.
    """
    calls = [partial(evaluate_set, known, line) for line in estimators for known in sets]
    return tuple(chain.from_iterable(run_jobs(calls, n_jobs, 'weighing')))
