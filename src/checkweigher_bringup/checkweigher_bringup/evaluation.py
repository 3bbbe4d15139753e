# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The evaluation that the command line asks for: of bags, or of the simulated protocol."""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
import platform

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.output import check_output_file
from checkweigher_bringup.settings import (
    check_positive,
    estimator_names,
    line_parameters,
    places_of,
)
from checkweigher_bringup.training import ReadPasses, read_passes
from checkweigher_core.records import GRAMS
from checkweigher_core.whole_file import write_whole
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.prepackages import limits
from checkweigher_recording.archive.finding import find_bags
from checkweigher_recording.simulation.machine import CAUSES
from checkweigher_recording.simulation.simulator import CAPACITY, PROFILES
from checkweigher_validation.accuracy.classes import AccuracyClass, smallest_interval
from checkweigher_validation.accuracy.errors import Evaluation
from checkweigher_validation.accuracy.evaluating import Batch, evaluate_batches
from checkweigher_validation.accuracy.examples import Example, example_of, simulated_examples
from checkweigher_validation.accuracy.machine_tables import (
    family_csv,
    family_json,
    family_text,
)
from checkweigher_validation.accuracy.passes import KnownPass, group_by_speed
from checkweigher_validation.accuracy.tables import csv_text, json_text, text_table
from checkweigher_validation.protocol.machines_protocol import (
    PASSES,
    MachinesProtocol,
    evaluate_machines,
)
from checkweigher_validation.protocol.paper_protocol import MASSES, Protocol, evaluate_protocol
from checkweigher_validation.tuning.parameter_file import parameter_file
from checkweigher_validation.tuning.search import BUDGET
from checkweigher_validation.tuning.stated_lag import stated_lag, unchecked
from checkweigher_validation.tuning.tuner import FEWEST_PASSES, Tuned, tune

Result = tuple[Evaluation, Mapping[str, Tuned], int]


def evaluate(arguments: argparse.Namespace, n_jobs: int | None) -> int:
    """Weigh, show the table and write the files that are asked for.

    Return how many bags were passed over. `n_jobs` is as in `run_jobs`.
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
    if arguments.csv:
        write_whole(arguments.csv, csv_text(evaluation, accuracy_class))
    if arguments.json:
        write_whole(arguments.json, json_text(evaluation))
    if arguments.tuned:
        source = [f'{name}: {value}' for name, value in evaluation.provenance]
        write_whole(arguments.tuned, parameter_file(tuned, source))
    return broken


def evaluate_family(arguments: argparse.Namespace, n_jobs: int | None) -> int:
    """Tune and weigh on machines of the family, show the tables and write what is asked for.

    Arguments and result are those of `evaluate`.
    """
    _check(arguments)
    for option in ('train', 'profile', 'tuned', 'nominal'):
        if getattr(arguments, option) is not None:
            raise UserError(f'--{option}: is not for the protocol machines')
    check_positive(arguments, 'count', 'further')
    masses = tuple(mass / GRAMS for mass in arguments.mass) if arguments.mass else MASSES
    if not all(0 < mass <= CAPACITY for mass in masses):
        raise UserError(f'--mass: must be above 0 and up to {GRAMS * CAPACITY:g} g')
    for cause in arguments.without:
        if cause not in CAUSES:
            raise UserError(f'--without {cause}: is none of {", ".join(CAUSES)}')
    if arguments.passes < FEWEST_PASSES:
        raise UserError(f'--passes {arguments.passes}: tuning takes at least {FEWEST_PASSES}')
    accuracy_class = _accuracy_class(arguments)
    first, last = arguments.seed, arguments.seed + arguments.count - 1
    protocol = MachinesProtocol(
        tuple(range(first, last + 1)), arguments.passes, masses, arguments.further,
        without=tuple(arguments.without),
    )  # fmt: skip
    estimators = estimator_names(arguments.estimator, tuple(ESTIMATORS))
    budget = arguments.budget or BUDGET
    machines = evaluate_machines(
        protocol, estimators, line_parameters(arguments.params, None), budget=budget,
        n_jobs=n_jobs,
    )  # fmt: skip
    trained = ', '.join(f'{GRAMS * mass:g}' for mass in masses)
    less = f' without {", ".join(protocol.without)}' if protocol.without else ''
    title = f'Machines {first} to {last}{less}, tuned on {arguments.passes} passes a speed'
    provenance = (
        ('machines', f'simulated, profiles machine:{first} to machine:{last}{less}'),
        ('train', f'{arguments.passes} passes at each speed, of {trained} g in random order'),
        ('test', f'{PASSES} others'),
        ('attainable', f'ridge regression on {protocol.further} more passes of each speed'),
        ('tuning', f'{budget} evaluations of each estimator at each speed at most'),
        *_versions(),
    )
    print(family_text(machines, title))
    if arguments.html:
        from checkweigher_validation.report.machines_page import render_machines

        write_whole(arguments.html, render_machines(machines, title, provenance))
    if arguments.csv:
        write_whole(arguments.csv, family_csv(machines, accuracy_class))
    if arguments.json:
        write_whole(arguments.json, family_json(machines, title, provenance))
    return 0


def _accuracy_class(arguments: argparse.Namespace) -> AccuracyClass:
    name, interval, maximum = arguments.accuracy_class, arguments.interval, arguments.maximum
    if interval is not None and maximum is not None:
        raise UserError('--interval and --max: name one of them, --max gives the interval')
    try:
        if maximum is not None:
            e = smallest_interval(name, maximum / GRAMS)
        else:
            e = AccuracyClass().interval if interval is None else interval / GRAMS
        return AccuracyClass(name, arguments.factor, e, arguments.in_service)
    except ValueError as error:
        raise UserError(f'--class: {error}') from None


def _check(arguments: argparse.Namespace) -> None:
    """Refuse options that cannot be used, before the work and not after it."""
    if bool(arguments.bags) == bool(arguments.protocol):
        raise UserError('name bags, or --protocol paper or machines to simulate')
    check_positive(arguments, 'budget', 'jobs', 'nominal')
    if arguments.seed < 0:
        raise UserError(f'--seed {arguments.seed}: must not be negative')
    if arguments.tuned and not (arguments.train or arguments.protocol):
        raise UserError('--tuned: nothing would be tuned; add --train BAG')
    outputs = (arguments.html, arguments.csv, arguments.json, arguments.tuned)
    for path in outputs:
        check_output_file(path, arguments.overwrite)
        if path is not None and outputs.count(path) > 1:
            raise UserError(f'{path}: cannot be two of the outputs at once')


def _evaluate_simulation(arguments: argparse.Namespace, n_jobs: int | None) -> Result:
    """Run the protocol of the paper on a simulated machine."""
    profile = arguments.profile or 'paper'
    if profile not in PROFILES:
        raise UserError(f'--profile {profile}: is none of {", ".join(PROFILES)}')
    if arguments.passes < 2 or arguments.passes % 2:
        raise UserError(f'--passes {arguments.passes}: must be even, half train and half test')
    if arguments.train:
        raise UserError('--train: the protocol trains on its own first half')
    base = line_parameters(arguments.params, None)
    estimators = estimator_names(arguments.estimator, tuple(ESTIMATORS))
    protocol = Protocol(profile, arguments.passes, arguments.seed)
    budget = arguments.budget or BUDGET
    conditions, tuned = evaluate_protocol(protocol, estimators, base, budget=budget, n_jobs=n_jobs)
    half = protocol.passes // 2
    provenance = (
        ('machine', f'simulated, profile {protocol.profile}, seed {protocol.seed}'),
        ('passes', f'{protocol.passes} of each mass at each speed, the masses in random order'),
        ('train', f'the first {half} of each mass'),
        ('test', f'the other {half}'),
        ('tuning', f'{budget} evaluations of each estimator at each speed at most'),
        *_versions(),
    )
    title = f'Protocol of the paper, profile {protocol.profile}'
    shown = tuned['iswd_eksi'].parameters if 'iswd_eksi' in tuned else base
    ends = (protocol.speeds[0], protocol.speeds[-1])
    examples = simulated_examples(protocol.profile, ends, max(MASSES), shown, protocol.seed)
    return Evaluation(title, conditions, provenance, examples), tuned, 0


def _evaluate_bags(arguments: argparse.Namespace, n_jobs: int | None) -> Result:
    """Weigh the passes of known mass in bags, after tuning if there are bags to train on."""
    base = line_parameters(arguments.params, None)
    default = tuple(ESTIMATORS) if arguments.train else (base.identifier.estimator,)
    estimators = estimator_names(arguments.estimator, default)
    taught = ReadPasses([], [], 0)
    if arguments.train:
        bags = places_of(arguments, find_bags(arguments.train))
        taught = read_passes(bags, arguments.lane, unchecked(base.segmenter), n_jobs)
        base = replace(base, segmenter=stated_lag(taught.passes, base.segmenter))
    trained = taught.passes
    bags = places_of(arguments, find_bags(arguments.bags))
    read = read_passes(bags, arguments.lane, base.segmenter, n_jobs)
    passes = read.passes
    provenance = [('test', line) for line in read.lines]
    provenance += [('train', line) for line in taught.lines]
    batches = _batches(trained, passes)
    if arguments.train:
        tuned = tune(
            group_by_speed(trained), estimators, base, budget=arguments.budget or BUDGET,
            n_jobs=n_jobs)  # fmt: skip
        lines = [tuned[name].parameters for name in estimators]
    else:
        tuned = {}
        lines = [base.with_estimator(name) for name in estimators]
        if arguments.params:
            provenance.append(('parameters', str(arguments.params)))
    conditions = evaluate_batches(batches, lines, n_jobs)
    evaluation = Evaluation('Bags', conditions, (*provenance, *_versions()), _shown(passes, base))
    return evaluation, tuned, taught.broken + read.broken


def _shown(passes: list[KnownPass], base: LineParameters) -> tuple[Example, ...]:
    """Return the heaviest pass of the slowest and of the fastest speed."""
    groups = group_by_speed(passes)
    ends = groups if len(groups) == 1 else (groups[0], groups[-1])
    return tuple(
        example_of(max(group.passes, key=lambda each: each.mass), group.speed, base.denoise)
        for group in ends
    )


def _batches(train: list[KnownPass], test: list[KnownPass]) -> list[Batch]:
    """Return passes by part and belt speed; a fault goes to the nearest in time that has one.

    The speeds are those of both parts together, so that their results stand side by side.
    """
    if not any(each.whole for each in test):
        raise UserError('no pass can be weighed; see ./checkweigher weigh for the reasons')
    if len({each.window.sample_rate for each in (*train, *test) if each.whole}) > 1:
        raise UserError('--train: these bags are sampled at another rate than those of the test')
    groups = group_by_speed((*train, *test))
    speeds = {id(each): group.speed for group in groups for each in group.passes}
    batches = []
    for part, passes in (('train', train), ('test', test)):
        chosen: dict[float, list[KnownPass]] = {group.speed: [] for group in groups}
        last = next((speeds[id(each)] for each in passes if each.whole), groups[0].speed)
        for each in passes:
            last = speeds.get(id(each), last)
            chosen[last].append(each)
        batches += [Batch(speed, part, tuple(each), {}) for speed, each in chosen.items() if each]
    return batches


def _versions() -> tuple[tuple[str, str], ...]:
    libraries = ((name, version(name)) for name in ('numpy', 'scipy', 'PyWavelets'))
    return ('Python', platform.python_version()), *libraries
