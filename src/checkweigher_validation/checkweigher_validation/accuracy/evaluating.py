# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weighing passes of known mass by several estimators, for the accuracy tables."""

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

_MASS_STEP = 1e-6  # kg; smaller differences of references are ignored


@dataclass(frozen=True, slots=True)
class PassSet:
    """Passes of one nominal speed that are reported together, including faults."""

    speed: float  # m/s
    part: str  # 'train' or 'test'
    passes: tuple[KnownPass, ...]
    bounds: Mapping[float, float] = field(default_factory=dict)  # Gauss-Markov bound by mass, kg


def weigh_passes(passes: Iterable[KnownPass], parameters: LineParameters) -> list[MassEstimate]:
    """Return the estimate of each pass by the denoise and identifier stages."""
    windows = [each.window for each in passes]
    return estimate_masses(windows, Denoiser(parameters.denoise), Identifier(parameters.identifier))


def evaluate_set(known: PassSet, parameters: LineParameters) -> list[ConditionResult]:
    """Return the results of the selected estimator on a set, one condition per mass."""
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

    Each of the `estimators` selects a different estimator. `n_jobs` is the number of processes, as
    in `checkweigher_validation.jobs.run_jobs`.
    """
    calls = [partial(evaluate_set, known, line) for line in estimators for known in sets]
    return tuple(chain.from_iterable(run_jobs(calls, n_jobs, 'weighing')))
