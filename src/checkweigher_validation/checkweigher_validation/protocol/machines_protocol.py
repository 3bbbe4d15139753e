# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Test of estimators on randomly drawn machines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.simulation.machine import PREFIX
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters, own_values
from checkweigher_validation.accuracy.errors import ConditionResult, Evaluation
from checkweigher_validation.accuracy.evaluating import PassSet, evaluate_sets
from checkweigher_validation.accuracy.machine_tables import ATTAINABLE, CHOSEN, MachineResult
from checkweigher_validation.accuracy.paper_table import PAPER_MASSES
from checkweigher_validation.accuracy.passes import (
    KnownPass,
    SpeedGroup,
    passes_by_cut,
    whole_passes,
)
from checkweigher_validation.jobs import run_jobs
from checkweigher_validation.protocol.attainable import attainable_errors
from checkweigher_validation.tuning.choice import CANDIDATES, choose, with_untrained
from checkweigher_validation.tuning.search import BUDGET
from checkweigher_validation.tuning.stated_lag import unchecked
from checkweigher_validation.tuning.tuner import UNTRAINED, Tuned, tune

MASSES = PAPER_MASSES  # masses of the test passes in kg
SPEEDS = (0.5, 1.0, 1.5)  # default belt speeds in m/s
PASSES = 120  # number of test passes at each speed
FURTHER = 1500  # number of passes at each speed from which the attainable accuracy is learned


@dataclass(frozen=True, slots=True)
class MachinesProtocol:
    """Machines, belt speeds, and numbers of passes at each speed."""

    machines: tuple[int, ...]  # seeds of the machines
    training: int = PASSES  # number of training passes
    training_masses: tuple[float, ...] = MASSES  # masses in kg of the training passes
    further: int = FURTHER  # number of passes from which the attainable accuracy is learned
    speeds: tuple[float, ...] = SPEEDS  # belt speeds in m/s
    without: tuple[str, ...] = ()  # causes of disturbance that are removed from the machines


@dataclass(frozen=True, slots=True, eq=False)
class MachineRun:
    """Passes of a machine at one speed in m/s, and the attainable accuracy on the test passes.

    The weighing windows of `train` and `test` are cut by the photo-eyes alone. The windows of
    `train_untrained` and `untrained` belong to the same passes, but are cut as on a line without
    training. A line without training also compares the edges of the photo-eyes with the rise of the
    load.
    """

    speed: float
    train: tuple[KnownPass, ...]
    train_untrained: tuple[KnownPass, ...]
    test: tuple[KnownPass, ...]
    untrained: tuple[KnownPass, ...]
    attainable: tuple[ConditionResult, ...]


def passes_cut_by(
    machine: int,
    speed: float,
    masses: Sequence[float],
    count: int,
    seed: int,
    cuts: Sequence[SegmenterParameters],
    without: tuple[str, ...] = (),
) -> list[tuple[KnownPass, ...]]:
    """Simulate `count` passes of a machine, with known masses in random order.

    `speed` is the belt speed in m/s. `masses` contains the masses in kg, which are repeated until
    there are `count` of them. Returns the passes for each element of `cuts`, which contains
    parameters of the segmenter. `machine` is the seed of the machine, and `seed` is the seed of the
    passes. `without` contains the causes of disturbance that are removed from the machine.
    """
    order = np.random.default_rng((machine, round(1000 * speed), seed))
    profile = '-'.join((f'{PREFIX}{machine}', *without))
    chosen = {
        'profile': profile,
        'speed': speed,
        'count': count,
        'seed': int(order.integers(2**31)),
        'masses': tuple(order.permutation(np.resize(masses, count)).tolist()),
    }
    simulation = Simulation(SimulationParameters.from_mapping(own_values(profile) | chosen))
    return [tuple(each) for each in passes_by_cut(simulation.load_cell, simulation, cuts)]


def run_machine(
    protocol: MachinesProtocol, machine: int, speed: float, segmenter: SegmenterParameters
) -> MachineRun:
    """Simulate a machine at one speed in m/s, and compute the attainable accuracy."""
    eyes, without = unchecked(segmenter), protocol.without
    taught, count, cuts = protocol.training_masses, protocol.training, (eyes, segmenter)
    train, as_untrained = passes_cut_by(machine, speed, taught, count, 0, cuts, without)
    test, untrained = passes_cut_by(machine, speed, MASSES, PASSES, 1, cuts, without)
    (further,) = passes_cut_by(machine, speed, MASSES, protocol.further, 2, (eyes,), without)
    whole = whole_passes(test)
    errors = attainable_errors(whole_passes(further), whole)
    weighed = np.array([each.mass for each in whole])
    attainable = []
    for mass in MASSES:
        own = errors[weighed == mass]
        unstated = np.full(len(own), np.nan)
        attainable.append(ConditionResult(ATTAINABLE, speed, mass, 'test', own, unstated))
    return MachineRun(speed, train, as_untrained, test, untrained, tuple(attainable))


def evaluate_machines(
    protocol: MachinesProtocol,
    estimators: Sequence[str],
    base: LineParameters,
    *,
    budget: int = BUDGET,
    n_jobs: int | None = None,
) -> tuple[MachineResult, ...]:
    """Simulate machines, and evaluate the estimators on each of them with and without tuning.

    The tuned estimators weigh training and test passes, and the untrained estimators weigh the test
    passes. The other parameters are as in `checkweigher_validation.tuning.tuner.tune`. Raises
    `TuningError` if an estimator cannot be tuned on one of the machines.
    """
    calls = [
        partial(run_machine, protocol, machine, speed, base.segmenter)
        for machine in protocol.machines
        for speed in protocol.speeds
    ]
    found = iter(run_jobs(calls, n_jobs, 'simulating'))
    results = []
    for machine in protocol.machines:
        runs = [next(found) for _ in protocol.speeds]
        groups = [SpeedGroup(run.speed, whole_passes(run.train)) for run in runs]
        tuned = tune(groups, estimators, base, budget=budget, n_jobs=n_jobs)
        compared = {name: tuned[name] for name in CANDIDATES if name in tuned}
        default = [SpeedGroup(run.speed, whole_passes(run.train_untrained)) for run in runs]
        chosen, _ = choose(with_untrained(compared, default, base))
        results.append(_weigh(machine, runs, tuned, chosen, base, n_jobs))
    return tuple(results)


def _weigh(
    machine: int,
    runs: Sequence[MachineRun],
    tuned: Mapping[str, Tuned],
    chosen: str,
    base: LineParameters,
    n_jobs: int | None,
) -> MachineResult:
    """Return the results of the tuned estimators, and of the same estimators without training."""
    parts = [*_sets(runs, 'train', 'train'), *_sets(runs, 'test', 'test')]
    unknown = _sets(runs, 'test', 'untrained')
    attainable = [one for run in runs for one in run.attainable]
    found = evaluate_sets(parts, [each.parameters for each in tuned.values()], n_jobs)
    untrained = evaluate_sets(unknown, [base.with_estimator(name) for name in tuned], n_jobs)
    best = [one for one in found if one.estimator == chosen]
    if chosen == UNTRAINED:
        cut = _sets(runs, 'train', 'train_untrained')
        best = list(evaluate_sets([*cut, *unknown], [base], n_jobs))
    renamed = [replace(one, estimator=CHOSEN) for one in best]
    title = f'machine {machine}'
    return MachineResult(
        machine,
        tuned=Evaluation(title, (*attainable, *found, *renamed), ()),
        untrained=Evaluation(title, (*attainable, *untrained), ()),
        chosen=chosen,
    )


def _sets(runs: Sequence[MachineRun], part: str, name: str) -> list[PassSet]:
    """Return the passes in the field `name` of each run as a set of the part `part`."""
    return [PassSet(run.speed, part, getattr(run, name)) for run in runs]
