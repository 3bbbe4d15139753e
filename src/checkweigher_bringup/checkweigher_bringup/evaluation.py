# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of estimators on bags or on a simulated protocol, for the command `evaluate`."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
import platform

from checkweigher_bringup import settings
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.output import check_output_file
from checkweigher_bringup.training import ReadPasses, read_passes
from checkweigher_core.records import GRAMS
from checkweigher_core.whole_file import write_whole
from checkweigher_dsp.estimation.estimators import METHODS, REFERENCES
from checkweigher_dsp.estimation.identifier import ComparedParameters
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.prepackages import limits
from checkweigher_recording.archive.finding import find_bags
from checkweigher_recording.simulation.machine import CAUSES
from checkweigher_recording.simulation.operation import CAPACITY
from checkweigher_recording.simulation.simulator import PROFILES
from checkweigher_validation.accuracy.classes import AccuracyClass, smallest_interval
from checkweigher_validation.accuracy.errors import Evaluation
from checkweigher_validation.accuracy.evaluating import PassSet, evaluate_sets
from checkweigher_validation.accuracy.examples import Example, example_of, simulated_examples
from checkweigher_validation.accuracy.machine_tables import family_csv, family_json, family_text
from checkweigher_validation.accuracy.passes import KnownPass, SpeedGroup, group_by_speed
from checkweigher_validation.accuracy.tables import csv_text, json_text, text_table
from checkweigher_validation.protocol.machines_protocol import (
    PASSES,
    MachinesProtocol,
    evaluate_machines,
)
from checkweigher_validation.protocol.paper_protocol import MASSES, Protocol, evaluate_protocol
from checkweigher_validation.tuning.parameter_file import parameter_file
from checkweigher_validation.tuning.stated_lag import stated_lag, unchecked
from checkweigher_validation.tuning.tuner import FEWEST_PASSES, Tuned, tune

# Accuracy of the estimators, tuned parameters by estimator, and number of skipped bags.
Result = tuple[Evaluation, Mapping[str, Tuned], int]


def evaluate(arguments: argparse.Namespace, n_jobs: int | None) -> int:
    """Weigh the passes, print the table of accuracies, and write the requested files.

    Returns the number of bags that were skipped. `n_jobs` is the number of processes, as in
    `checkweigher_validation.jobs.run_jobs`.

    Raises `UserError` if the options cannot be used together, or no pass can be weighed. Raises the
    exceptions of `read_passes` and `tune`, and `OutputError` if a file cannot be written.
    """
    _check(arguments)
    accuracy_class = _accuracy_class(arguments)
    nominal = None if arguments.nominal is None else arguments.nominal / GRAMS
    try:
        if nominal is not None:
            limits(nominal)
    except ValueError as error:
        raise UserError(f'--nominal: {error}') from None
    weigh = _evaluate_simulation if arguments.protocol else _evaluate_bags
    evaluation, tuned, broken = weigh(arguments, n_jobs)
    print(text_table(evaluation, accuracy_class))
    if arguments.html:
        from checkweigher_validation.report.page import render

        write_whole(arguments.html, render(evaluation, accuracy_class, nominal))
    _write(arguments.csv, csv_text(evaluation, accuracy_class))
    _write(arguments.json, json_text(evaluation))
    if arguments.tuned:
        source = [f'{name}: {value}' for name, value in evaluation.provenance]
        offered = {name: each for name, each in tuned.items() if name not in REFERENCES}
        write_whole(arguments.tuned, parameter_file(offered, source))
    return broken


def evaluate_family(arguments: argparse.Namespace, n_jobs: int | None) -> int:
    """Tune and test estimators on simulated machines, print the tables, and write the files.

    The arguments are those of `evaluate`. Returns 0, because no bags are read.

    Raises `UserError` if the options cannot be used together, and `OutputError` if a file cannot be
    written.
    """
    _check(arguments)
    protocol = _machines_protocol(arguments)
    accuracy_class = _accuracy_class(arguments)
    estimators = settings.estimator_names(arguments.estimator, tuple(METHODS), METHODS)
    base = _line_parameters(arguments)
    machines = evaluate_machines(protocol, estimators, base, budget=arguments.budget, n_jobs=n_jobs)
    first, last = protocol.machines[0], protocol.machines[-1]
    trained = ', '.join(f'{GRAMS * mass:g}' for mass in protocol.training_masses)
    less = f' without {", ".join(protocol.without)}' if protocol.without else ''
    title = f'Machines {first} to {last}{less}, tuned on {arguments.passes} passes per speed'
    provenance = (
        ('machines', f'simulated, profiles machine:{first} to machine:{last}{less}'),
        ('train', f'{arguments.passes} passes at each speed, of {trained} g in random order'),
        ('test', f'{PASSES} other passes at each speed'),
        ('attainable', f'ridge regression on {protocol.further} further passes at each speed'),
        _tuning(arguments),
        *_versions(),
    )
    print(family_text(machines, title))
    if arguments.html:
        from checkweigher_validation.report.machines_page import render_machines

        write_whole(arguments.html, render_machines(machines, title, provenance))
    _write(arguments.csv, family_csv(machines, accuracy_class))
    _write(arguments.json, family_json(machines, title, provenance))
    return 0


def _write(path: Path | None, text: str) -> None:
    if path is not None:
        write_whole(path, text)


def _machines_protocol(arguments: argparse.Namespace) -> MachinesProtocol:
    refused = ('train', 'profile', 'tuned', 'nominal')
    settings.refuse(arguments, 'is not for the protocol machines', *refused)
    settings.check_positive(arguments, 'count', 'further')
    masses = tuple(mass / GRAMS for mass in arguments.mass) if arguments.mass else MASSES
    if not all(0 < mass <= CAPACITY for mass in masses):
        raise UserError(f'--mass: must be above 0 and up to {GRAMS * CAPACITY:g} g')
    for cause in arguments.without:
        if cause not in CAUSES:
            raise UserError(f'--without {cause}: is not one of {", ".join(CAUSES)}')
    if arguments.passes < FEWEST_PASSES:
        raise UserError(
            f'--passes {arguments.passes}: tuning needs at least {FEWEST_PASSES} passes'
        )
    machines = tuple(range(arguments.seed, arguments.seed + arguments.count))
    without = tuple(arguments.without)
    return MachinesProtocol(machines, arguments.passes, masses, arguments.further, without=without)


def _accuracy_class(arguments: argparse.Namespace) -> AccuracyClass:
    name, interval, maximum = arguments.accuracy_class, arguments.interval, arguments.max
    if interval is not None and maximum is not None:
        raise UserError('--interval and --max: give only one, because --max sets the interval')
    try:
        if maximum is not None:
            e = smallest_interval(name, maximum / GRAMS)
        else:
            e = AccuracyClass().interval if interval is None else interval / GRAMS
        return AccuracyClass(name, arguments.factor, e, arguments.in_service)
    except ValueError as error:
        raise UserError(f'--class: {error}') from None


def _check(arguments: argparse.Namespace) -> None:
    if bool(arguments.bags) == bool(arguments.protocol):
        raise UserError('give either bags, or --protocol paper or machines to simulate')
    settings.check_positive(arguments, 'budget', 'jobs', 'nominal')
    if arguments.seed < 0:
        raise UserError(f'--seed {arguments.seed}: must not be negative')
    if arguments.tuned and not (arguments.train or arguments.protocol):
        raise UserError('--tuned: nothing would be tuned; add --train BAG')
    if arguments.tuned and REFERENCES.keys() >= set(arguments.estimator or ('all',)):
        raise UserError('--tuned: a line can use none of these estimators; add another one')
    _check_outputs(arguments)


def _check_outputs(arguments: argparse.Namespace) -> None:
    outputs = (arguments.html, arguments.csv, arguments.json, arguments.tuned)
    for path in outputs:
        check_output_file(path, arguments.overwrite)
        if path is not None and outputs.count(path) > 1:
            raise UserError(f'{path}: is the path of two outputs; give each its own file')


def _evaluate_simulation(arguments: argparse.Namespace, n_jobs: int | None) -> Result:
    profile = arguments.profile or 'paper'
    if profile not in PROFILES:
        raise UserError(f'--profile {profile}: is not one of {", ".join(PROFILES)}')
    if arguments.passes < 2 or arguments.passes % 2:
        raise UserError(f'--passes {arguments.passes}: must be even, for two halves')
    settings.refuse(arguments, 'not with --protocol, which trains on its own passes', 'train')
    base = _line_parameters(arguments)
    estimators = settings.estimator_names(arguments.estimator, tuple(METHODS), METHODS)
    protocol = Protocol(profile, arguments.passes, arguments.seed)
    conditions, tuned = evaluate_protocol(
        protocol, estimators, base, budget=arguments.budget, n_jobs=n_jobs
    )
    half = protocol.passes // 2
    provenance = (
        ('machine', f'simulated, profile {profile}, seed {protocol.seed}'),
        ('passes', f'{protocol.passes} of each mass at each speed, the masses in random order'),
        ('train', f'the first {half} of each mass'),
        ('test', f'the other {half}'),
        _tuning(arguments),
        *_versions(),
    )
    shown = tuned['iswd_eksi'].parameters if 'iswd_eksi' in tuned else base
    ends = (protocol.speeds[0], protocol.speeds[-1])
    examples = simulated_examples(profile, ends, max(MASSES), shown, protocol.seed)
    title = f'Protocol of the paper, profile {profile}'
    return Evaluation(title, conditions, provenance, examples), tuned, 0


def _evaluate_bags(arguments: argparse.Namespace, n_jobs: int | None) -> Result:
    """Weigh the passes of known mass in bags. Tune first if the user gave bags to train on.

    Raises `UserError` if no pass can be weighed, and the exceptions of `read_passes` and `tune`.
    """
    base = _line_parameters(arguments)
    default = tuple(METHODS) if arguments.train else (base.identifier.estimator,)
    estimators = settings.estimator_names(arguments.estimator, default, METHODS)
    taught = ReadPasses([], [], 0)
    if arguments.train:
        bags = settings.places_of(arguments, find_bags(arguments.train))
        taught = read_passes(bags, arguments.lane, unchecked(base.segmenter), n_jobs)
        base = replace(base, segmenter=stated_lag(taught.passes, base.segmenter))
    bags = settings.places_of(arguments, find_bags(arguments.bags))
    read = read_passes(bags, arguments.lane, base.segmenter, n_jobs)
    provenance = [('test', line) for line in read.lines]
    provenance += [('train', line) for line in taught.lines]
    sets = _sets(taught.passes, read.passes)
    tuned: Mapping[str, Tuned] = {}
    lines = [base.with_estimator(name) for name in estimators]
    if arguments.train:
        groups = group_by_speed(taught.passes)
        tuned = tune(groups, estimators, base, budget=arguments.budget, n_jobs=n_jobs)
        lines = [tuned[name].parameters for name in estimators]
    elif arguments.params:
        provenance.append(('parameters', str(arguments.params)))
    conditions = evaluate_sets(sets, lines, n_jobs)
    examples = _examples(read.passes, base)
    evaluation = Evaluation('Bags', conditions, (*provenance, *_versions()), examples)
    return evaluation, tuned, taught.broken + read.broken


def _examples(passes: list[KnownPass], base: LineParameters) -> tuple[Example, ...]:
    """Return examples of the heaviest pass at the lowest speed and at the highest speed.

    If all passes have the same speed, only one example is returned.
    """
    groups = group_by_speed(passes)
    ends = groups if len(groups) == 1 else (groups[0], groups[-1])
    return tuple(
        example_of(max(group.passes, key=lambda each: each.mass), group.speed, base.denoise)
        for group in ends
    )


def _sets(train: list[KnownPass], test: list[KnownPass]) -> list[PassSet]:
    """Return the passes for training and for the test, grouped by belt speed.

    Training and test have the same speed groups, so that their results can be compared. Raises
    `UserError` if no test pass can be weighed, or if the sample rates of the passes differ.
    """
    whole = [each for each in (*train, *test) if each.whole]
    if not any(each.whole for each in test):
        raise UserError('no pass can be weighed; checkweigher weigh shows the reasons')
    if len({each.window.sample_rate for each in whole}) > 1:
        raise UserError('--train: the sample rate of these bags differs from that of the others')
    groups = group_by_speed(whole)
    return [*_by_speed('train', train, groups), *_by_speed('test', test, groups)]


def _by_speed(
    part: str, passes: list[KnownPass], groups: Sequence[SpeedGroup]
) -> Iterator[PassSet]:
    """Yield a `PassSet` with the name `part` for each speed. Speeds without passes are left out.

    A pass with faults belongs to the speed of the previous pass without faults. If all earlier
    passes have faults, the pass belongs to the speed of the next pass without faults. If all passes
    have faults, they belong to the lowest speed.
    """
    speeds = {id(each): group.speed for group in groups for each in group.passes}
    chosen: dict[float, list[KnownPass]] = {group.speed: [] for group in groups}
    speed = next((speeds[id(each)] for each in passes if each.whole), groups[0].speed)
    for each in passes:
        speed = speeds.get(id(each), speed)
        chosen[speed].append(each)
    return (PassSet(speed, part, tuple(found)) for speed, found in chosen.items() if found)


def _line_parameters(arguments: argparse.Namespace) -> LineParameters:
    """Return the parameters of the line and of the estimators that only `evaluate` has."""
    base = settings.line_parameters(arguments.params)
    compared = ComparedParameters.from_mapping(base.identifier.as_mapping())
    return replace(base, identifier=compared)


def _tuning(arguments: argparse.Namespace) -> tuple[str, str]:
    return 'tuning', f'at most {arguments.budget} evaluations of each estimator at each speed'


def _versions() -> tuple[tuple[str, str], ...]:
    libraries = ((name, version(name)) for name in ('numpy', 'scipy', 'PyWavelets'))
    return ('Python', platform.python_version()), *libraries
