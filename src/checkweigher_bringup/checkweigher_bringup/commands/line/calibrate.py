# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibrate the load cell with known masses at rest, or train on passes of a known mass.

Examples
--------
checkweigher calibrate --masses 200 500 1000
checkweigher calibrate --dynamic --reference 134.5 --speeds 30 60 90
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
    NAMESPACE,
    ('--mass-uncertainty G', float, 'standard uncertainty of each mass in g; default 0', 0.0),
    ('--max-residual G', float, 'largest residual in g for which the result is written'),
    'dynamic setting',
    ('--reference G', float, 'mass in g of each product that passes'),
    ('--passes N', int, 'number of passes at each speed; default 60', 60),
    ('--speeds M_PER_MIN', [float], 'belt speeds in m/min, in the order of the recordings'),
    'with a file of your own, instead of the files and settings of the line',
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
    ('--duration S', float, 'duration of each reading in s; default 5'),
    ('--tolerance G', float, 'largest drift of a reading in g; default 0.1'),
    ('--bags DIR', Path, 'folder for the recorded bags; default OUTPUT_passes'),
    ('--estimator NAME', str, 'estimator to train; default: the best one on held-out passes'),
    ('--budget N', int, 'largest number of evaluations, as in tune; default 240'),
)
# Options that need --output, because without --output the running line uses its own settings.
_OWN = 'source', 'open', 'params', 'duration', 'tolerance', 'bags', 'estimator', 'budget'


def run(arguments: argparse.Namespace) -> int:
    """Guide the user through the calibration or the training of a line.

    With `--output`, write a parameter file. Without `--output`, let the line write its own files.

    Raises `UserError` or `CalibrationError` if options are missing or cannot be used together, or
    if the calibration cannot be completed. Raises `UserError` or `TuningError` if the training
    cannot be completed.
    """
    if not (arguments.masses or arguments.zero or arguments.dynamic):
        raise UserError(
            'choose one of --masses (known masses at rest), --zero (the empty belt only) and '
            '--dynamic (passes of --reference at each of --speeds)'
        )
    if arguments.output is None:
        _set_line(arguments)
    elif arguments.dynamic:
        from checkweigher_bringup.commissioning.dynamic_guide import set_dynamically

        set_dynamically(arguments)
    else:
        from checkweigher_bringup.commissioning.static_guide import calibrate_at_rest

        calibrate_at_rest(arguments)
    return 0


def _set_line(arguments: argparse.Namespace) -> None:
    """Calibrate or train a running line by the ROS actions of its nodes.

    Raises `UserError` if an option that needs `--output` was given.
    """
    from checkweigher_bringup.commissioning.line_guide import calibrate_line, train_line
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_core.records import GRAMS

    if given := [f'--{name}' for name in _OWN if _is_given(getattr(arguments, name))]:
        raise UserError(
            f'--output: must name the parameter file to write with {" ".join(given)}; a line '
            'without --output uses its own files and settings'
        )
    namespace = check_namespace(arguments.namespace)
    if arguments.dynamic:
        from checkweigher_bringup.commissioning.dynamic_guide import check_passes

        check_passes(arguments)
        train_line(namespace, arguments.reference / GRAMS, arguments.passes, arguments.speeds)
        return
    from checkweigher_bringup.commissioning.static_guide import check_masses

    check_masses(arguments)
    masses = [mass / GRAMS for mass in arguments.masses or ()]
    uncertainty, residual = arguments.mass_uncertainty, arguments.max_residual or 0.0
    calibrate_line(namespace, masses, uncertainty / GRAMS, residual / GRAMS)


def _is_given(value: object) -> bool:
    return value is not None and value is not False
