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
from checkweigher_validation.accuracy.errors import ConditionResult, distinct, same
from checkweigher_validation.accuracy.passes import KnownPass
from checkweigher_validation.jobs import run_jobs


@dataclass(frozen=True, slots=True)
class PassSet:
    """Passes of one nominal speed and one part, including passes that cannot be weighed."""

    speed: float  # nominal belt speed in m/s
    part: str  # 'train' or 'test'
    passes: tuple[KnownPass, ...]
    # Gauss-Markov bounds of sigma in kg by mass in kg. Unknown bounds are absent.
    bounds: Mapping[float, float] = field(default_factory=dict)


def weigh_passes(passes: Iterable[KnownPass], parameters: LineParameters) -> list[MassEstimate]:
    """Denoise and weigh each pass with the selected estimator, and return the estimates."""
    windows = [each.window for each in passes]
    return estimate_masses(windows, Denoiser(parameters.denoise), Identifier(parameters.identifier))


def evaluate_set(known: PassSet, parameters: LineParameters) -> list[ConditionResult]:
    """Return the results of the selected estimator at each mass of a set, by ascending mass.

    A pass without a mass counts as a fault.
    """
    masses = [each.mass for each in known.passes]
    pairs = list(zip(masses, weigh_passes(known.passes, parameters), strict=True))
    results = []
    for mass in distinct(masses):
        own = [(true, found) for true, found in pairs if same(true, mass)]
        weighed = [(true, found) for true, found in own if found.weighed]
        result = ConditionResult(
            parameters.identifier.estimator,
            known.speed,
            mass,
            known.part,
            errors=np.array([found.mass - true for true, found in weighed]),
            std_devs=np.array([found.std_dev for _, found in weighed]),
            faults=len(own) - len(weighed),
            bound=known.bounds.get(mass, math.nan),
        )
        results.append(result)
    return results


def evaluate_sets(
    sets: Sequence[PassSet], estimators: Sequence[LineParameters], n_jobs: int | None = None
) -> tuple[ConditionResult, ...]:
    """Return the results of estimators on sets of passes, in the order of the estimators.

    `estimators` contains parameters that select different estimators. `n_jobs` is the number of
    processes as in `checkweigher_validation.jobs.run_jobs`.
    """
    calls = [partial(evaluate_set, known, line) for line in estimators for known in sets]
    return tuple(chain.from_iterable(run_jobs(calls, n_jobs, 'weighing')))
