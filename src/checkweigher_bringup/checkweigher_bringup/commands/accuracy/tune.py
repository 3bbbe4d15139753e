# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learn parameters from passes of known mass.

Examples
--------
checkweigher tune bags/paper_30 bags/paper_60 bags/paper_90 --output machine.yaml
checkweigher tune day1 --output machine.yaml --scheduler tcp://10.0.0.5:8786
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import OVERWRITE, REQUIRED, TUNING, bags

OPTIONS = (
    bags('bags with reference_mass, at any belt speeds'),
    ('--output FILE', Path, 'parameter file to write', REQUIRED),
    OVERWRITE,
    *TUNING,
    ('--params FILE', Path, 'ROS parameter file (YAML) with the parameters that are not tuned'),
)


def run(arguments: argparse.Namespace) -> int:
    """Tune estimators, and write the parameter file. Return 1 if a bag was skipped, otherwise 0."""
    from checkweigher_bringup import settings
    from checkweigher_bringup.output import check_output_file
    from checkweigher_bringup.training import train
    from checkweigher_recording.archive.finding import find_bags

    given = arguments.estimator
    estimators = settings.estimator_names(given, ('iswd_eksi',)) if given else None
    settings.check_positive(arguments, 'budget', 'jobs')
    output: Path = arguments.output
    check_output_file(output, arguments.overwrite)
    lane, budget = arguments.lane, arguments.budget
    base = settings.line_parameters(arguments.params, lane=lane)
    bags = settings.places_of(arguments, find_bags(arguments.bags))
    with settings.on_scheduler_of(arguments) as n_jobs:
        broken = train(bags, output, estimators, base, budget=budget, lane=lane, n_jobs=n_jobs)
    print(f'{output}: written; use it as the parameter file of weigh, replay and the nodes')
    return int(broken > 0)
