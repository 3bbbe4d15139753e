# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibrate the load cell with known masses at rest, or train on passes of a known mass.

checkweigher calibrate --masses 200 500 1000 --source aed --output /etc/checkweigher/lane1.yaml
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import NAMESPACE
from checkweigher_bringup.errors import UserError

OPTIONS = (
    (
        ('--masses G', [float], 'known masses in g, in the order of their use'),
        ('--zero', bool, 'read only the empty belt, and keep the sensitivity'),
        ('--dynamic', bool, 'record passes of --reference at each of --speeds, and train on them'),
    ),
    ('--output FILE', Path, 'parameter file to write; an existing file is kept as a version'),
    (
        '--source NAME',
        str,
        'source to calibrate: simulator, aed or ascii; not with --dynamic',
    ),
    ('--open', bool, 'read the samples from the source itself instead of a running line'),
    (
        '--params FILE',
        Path,
        'ROS parameter file (YAML) of the source, which is copied to the new file; with --dynamic, '
        'the parameters that are not trained',
    ),
    NAMESPACE,
    ('--mass-uncertainty G', float, 'standard uncertainty of each mass in g; default 0', 0.0),
    ('--duration S', float, 'duration of each reading in s; default 5', 5.0),
    ('--tolerance G', float, 'largest drift of a reading in g; default 0.1', 0.1),
    ('--max-residual G', float, 'largest residual in g for which the file is written'),
    'dynamic setting',
    ('--reference G', float, 'mass in g of each product that passes'),
    ('--passes N', int, 'number of passes at each speed; default 60', 60),
    ('--speeds M_PER_MIN', [float], 'belt speeds in m/min, in the order of the recordings'),
    ('--bags DIR', Path, 'folder for the recorded bags; default OUTPUT_passes'),
    ('--estimator NAME', str, 'estimator to train; default: the best one on held-out passes'),
    ('--budget N', int, 'largest number of evaluations, as in tune; default 240', 240),
)


def run(arguments: argparse.Namespace) -> int:
    """Guide the user through the masses or the speeds, and write the parameter file."""
    if not (arguments.masses or arguments.zero or arguments.dynamic):
        raise UserError(
            'choose what to set: --masses G ... (known masses at rest), --zero (the empty belt '
            'only) or --dynamic (passes of --reference at each of --speeds)'
        )
    if arguments.output is None:
        raise UserError('--output: must name the parameter file to write')
    if arguments.dynamic:
        from checkweigher_bringup.commissioning.dynamic_guide import set_dynamically

        set_dynamically(arguments)
    else:
        from checkweigher_bringup.commissioning.static_guide import calibrate_at_rest

        calibrate_at_rest(arguments)
    return 0
