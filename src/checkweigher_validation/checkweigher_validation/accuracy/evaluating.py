"""Weighing passes of known mass by several estimators, for the accuracy tables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

from joblib import delayed
import numpy as np

from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.estimation.identifier import Identifier
from checkweigher_dsp.pipeline.line import LineParameters, estimate_masses
from checkweigher_dsp.records import MassEstimate
from checkweigher_validation.accuracy.errors import ConditionResult
from checkweigher_validation.accuracy.passes import KnownPass
from checkweigher_validation.jobs import run_jobs

_MASS_STEP = 1e-6  # kg; references that differ by less are one mass


@dataclass(frozen=True, slots=True)
class Batch:
    """Passes that ran at one speed and are reported together.

    Attributes
    ----------
    speed : float
        m/s, nominal.
    part : str
        'train' or 'test'.
    passes : tuple of KnownPass
        Those that became faults included.
    bounds : dict of float to float
        Gauss-Markov bound by mass, kg; empty where it is not known.
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
    """Return the results of one estimator, a condition for each mass.

    Parameters
    ----------
    batch : Batch
        The passes.
    parameters : LineParameters
        With the estimator.
    """
    estimates = weigh_passes(batch.passes, parameters)
    masses = np.array([each.mass for each in batch.passes])
    keys = np.round(masses / _MASS_STEP)
    results = []
    for key in np.unique(keys):
        chosen = np.flatnonzero(keys == key)
        weighed = [number for number in chosen if estimates[number].weighed]
        mass = float(masses[chosen[0]])
        results.append(
            ConditionResult(
                estimator=parameters.identifier.estimator,
                speed=batch.speed,
                mass=mass,
                part=batch.part,
                errors=np.array([estimates[n].mass - masses[n] for n in weighed]),
                std_devs=np.array([estimates[n].std_dev for n in weighed]),
                faults=len(chosen) - len(weighed),
                bound=batch.bounds.get(mass, math.nan),
            )
        )
    return results


def evaluate_batches(
    batches: Sequence[Batch],
    estimators: Sequence[LineParameters],
    n_jobs: int | None = None,
) -> tuple[ConditionResult, ...]:
    """Return the results of estimators on batches, the estimators in their order.

    Parameters
    ----------
    batches : sequence of Batch
        The passes.
    estimators : sequence of LineParameters
        Parameters of the line, each with another estimator.
    n_jobs : int, optional
        Processes, as in `checkweigher_validation.jobs.run_jobs`.
    """
    calls = [
        delayed(evaluate_batch)(batch, parameters) for parameters in estimators for batch in batches
    ]
    found = run_jobs(calls, n_jobs, 'weighing')
    return tuple(condition for conditions in found for condition in conditions)
