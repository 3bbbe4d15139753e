# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learn parameters from passes of known mass."""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import add_bags, add_tuning

EXAMPLES = ('tune day1 --output machine.yaml --scheduler tcp://10.0.0.5:8786',)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `tune`."""
    add = parser.add_argument
    add_bags(parser, 'bags with reference_mass, of any speeds')
    add('--output', type=Path, required=True, metavar='FILE', help='parameter file to write')
    add('--overwrite', action='store_true', help='replace FILE if it exists')
    add_tuning(parser)
    add('--params', type=Path, metavar='FILE', help='parameters of everything that is not tuned')


def run(arguments: argparse.Namespace) -> int:
    """Tune and write the parameter file."""
    from checkweigher_bringup.output import check_output_file
    from checkweigher_bringup.settings import (
        check_positive,
        estimator_names,
        line_parameters,
        on_scheduler_of,
        places_of,
    )
    from checkweigher_bringup.training import BUDGET, train
    from checkweigher_recording.archive.finding import find_bags

    given = arguments.estimator
    estimators = estimator_names(given, ('iswd_eksi',)) if given else None
    check_positive(arguments, 'budget', 'jobs')
    check_output_file(arguments.output, arguments.overwrite)
    base = line_parameters(arguments.params, None, arguments.lane)
    bags = places_of(arguments, find_bags(arguments.bags))
    with on_scheduler_of(arguments) as n_jobs:
        broken = train(
            bags, arguments.output, estimators, base, budget=arguments.budget or BUDGET,
            lane=arguments.lane, n_jobs=n_jobs,
        )  # fmt: skip
    print(f'{arguments.output}: written; weigh, replay and the nodes take it as their parameters')
    return int(broken > 0)
