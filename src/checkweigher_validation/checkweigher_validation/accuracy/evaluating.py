# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weighing passes of known mass by several estimators, for the accuracy tables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
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

_MASS_STEP = 1e-6  # kg; references that differ by less are one mass


@dataclass(frozen=True, slots=True)
class Batch:
    """Passes that ran at one nominal speed in m/s and are reported together, faults included.

    The part is 'train' or 'test'. Bounds are those of Gauss and Markov by mass, in kg; empty where
    they are not known.
    """

    speed: float
    part: str
    passes: tuple[KnownPass, ...]
    bounds: dict[float, float]


def weigh_passes(passes: Iterable[KnownPass], parameters: LineParameters) -> list[MassEstimate]:
    """Return the estimate of each pass by the denoise and identifier stages."""
    windows = [each.window for each in passes]
    return estimate_masses(windows, Denoiser(parameters.denoise), Identifier(parameters.identifier))


def evaluate_batch(batch: Batch, parameters: LineParameters) -> list[ConditionResult]:
    """Return the results of the estimator of the parameters, a condition for each mass."""
    estimates = weigh_passes(batch.passes, parameters)
    masses = np.array([each.mass for each in batch.passes])
    keys = np.round(masses / _MASS_STEP)
    results = []
    for key in np.unique(keys):
        chosen = np.flatnonzero(keys == key)
        weighed = [number for number in chosen if estimates[number].weighed]
        mass = float(masses[chosen[0]])
        errors = np.array([estimates[n].mass - masses[n] for n in weighed])
        std_devs = np.array([estimates[n].std_dev for n in weighed])
        results.append(
            ConditionResult(
                parameters.identifier.estimator, batch.speed, mass, batch.part, errors, std_devs,
                faults=len(chosen) - len(weighed), bound=batch.bounds.get(mass, math.nan),
            )
        )  # fmt: skip
    return results


def evaluate_batches(
    batches: Sequence[Batch], estimators: Sequence[LineParameters], n_jobs: int | None = None
) -> tuple[ConditionResult, ...]:
    """Return the results of estimators on batches, the estimators in their order.

    Each set of parameters has another estimator. `n_jobs` counts processes, as in
    `checkweigher_validation.jobs.run_jobs`.
    """
    calls = [partial(evaluate_batch, batch, line) for line in estimators for batch in batches]
    return tuple(chain.from_iterable(run_jobs(calls, n_jobs, 'weighing')))
