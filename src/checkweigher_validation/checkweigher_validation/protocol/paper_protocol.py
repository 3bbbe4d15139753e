# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Test of the paper (Long et al.) with 5 speeds and 5 masses, on a simulated machine."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters
from checkweigher_validation.accuracy.errors import ConditionResult
from checkweigher_validation.accuracy.evaluating import PassSet, evaluate_sets
from checkweigher_validation.accuracy.paper_table import PAPER_MASSES, PAPER_SPEEDS
from checkweigher_validation.accuracy.passes import (
    KnownPass,
    SpeedGroup,
    known_passes,
    whole_passes,
)
from checkweigher_validation.jobs import run_jobs
from checkweigher_validation.protocol.gauss_markov_bound import bound
from checkweigher_validation.tuning.search import BUDGET
from checkweigher_validation.tuning.stated_lag import unchecked
from checkweigher_validation.tuning.tuner import Tuned, tune

SPEEDS = PAPER_SPEEDS
MASSES = PAPER_MASSES
PASSES = 120  # number of passes of each mass at each speed; one half is for training


@dataclass(frozen=True, slots=True)
class Run:
    """Passes of one nominal speed for training and test, and the parameters of the simulation."""

    train: tuple[KnownPass, ...]
    test: tuple[KnownPass, ...]
    simulation: SimulationParameters


@dataclass(frozen=True, slots=True)
class Protocol:
    """Parameters of the test with the masses of the paper."""

    profile: str = 'paper'  # profile of the simulated machine
    passes: int = PASSES  # number of passes of each mass at each speed
    seed: int = 1  # seed of all random numbers
    speeds: tuple[float, ...] = SPEEDS  # belt speeds in m/s


def run_protocol(protocol: Protocol, speed: float, segmenter: SegmenterParameters) -> Run:
    """Simulate all passes at one speed in m/s.

    The masses are in random order, so that the vibration that a product causes is independent of
    the mass of the next product. Each mass is equally frequent in both halves. Each speed has its
    own random numbers.
    """
    each = np.repeat(MASSES, protocol.passes // 2)
    order = np.random.default_rng((protocol.seed, round(1000 * speed)))
    masses = np.concatenate([order.permutation(each), order.permutation(each)])
    parameters = SimulationParameters(
        profile=protocol.profile,
        speed=speed,
        masses=tuple(masses.tolist()),
        count=len(masses),
        seed=int(order.integers(2**31)),
    )
    simulation = Simulation(parameters)
    known = tuple(known_passes(simulation.load_cell, simulation, segmenter))
    return Run(known[: len(each)], known[len(each) :], parameters)


def evaluate_protocol(
    protocol: Protocol,
    estimators: Sequence[str],
    base: LineParameters,
    *,
    budget: int = BUDGET,
    n_jobs: int | None = None,
) -> tuple[tuple[ConditionResult, ...], dict[str, Tuned]]:
    """Simulate all passes, tune the estimators on the first half of them, and weigh both halves.

    The other parameters are as in `checkweigher_validation.tuning.tuner.tune`. Returns the errors
    of each estimator at each speed and mass, and the tuned parameters of each estimator. Raises
    `TuningError` if an estimator cannot be tuned.
    """
    # Do not compare the photo-eyes with the rise of the load, because the simulated eyes are exact.
    exact = unchecked(base.segmenter)
    simulations = [partial(run_protocol, protocol, speed, exact) for speed in protocol.speeds]
    runs = run_jobs(simulations, n_jobs, 'simulating')
    computations = [partial(bound, run.simulation, mass) for run in runs for mass in MASSES]
    bounds = iter(run_jobs(computations, n_jobs, 'computing the bound'))
    groups = [SpeedGroup(run.simulation.speed, whole_passes(run.train)) for run in runs]
    tuned = tune(groups, estimators, base, budget=budget, n_jobs=n_jobs)
    sets = []
    for run in runs:
        bound_of = {mass: next(bounds) for mass in MASSES}
        for part, passes in (('train', run.train), ('test', run.test)):
            sets.append(PassSet(run.simulation.speed, part, passes, bound_of))
    return evaluate_sets(sets, [tuned[name].parameters for name in estimators], n_jobs), tuned
