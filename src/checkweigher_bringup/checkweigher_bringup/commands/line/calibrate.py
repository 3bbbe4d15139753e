# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibrate the load cell with known masses at rest.

checkweigher calibrate --masses 200 500 1000 --source aed --output /etc/checkweigher/lane1.yaml
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import NAMESPACE
from checkweigher_bringup.errors import UserError

OPTIONS = (
    (
        ('--masses G', [float], 'known masses, in the order of use'),
        ('--zero', bool, 'read the empty belt only, and keep the sensitivity'),
        ('--dynamic', bool, 'record passes of --reference at each of --speeds, and train on them'),
    ),
    ('--output FILE', Path, 'parameter file to write; one that exists is kept as a version'),
    (
        '--source NAME',
        str,
        'source whose calibration it is: simulator, aed or ascii; not with --dynamic',
    ),
    ('--open', bool, 'open the source; without, the samples are those of a running line'),
    ('--params FILE', Path, 'parameters of the source, which go into the new file as well'),
    NAMESPACE,
    ('--mass-uncertainty G', float, 'standard uncertainty of each mass', 0.0),
    ('--duration S', float, 'for which each mass is read', 5.0),
    ('--tolerance G', float, 'by which a load at rest may still move', 0.1),
    ('--max-residual G', float, 'write nothing if a mass is further off the line'),
    'dynamic setting',
    ('--reference G', float, 'mass of all that passes'),
    ('--passes N', int, 'at each speed; default 60', 60),
    ('--speeds M_PER_MIN', [float], 'belt speeds, in turn'),
    ('--bags DIR', Path, 'folder for the bags; default OUTPUT_passes'),
    ('--estimator NAME', str, 'what is trained; default the best of all'),
    ('--budget N', int, 'as that of tune', 240),
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
