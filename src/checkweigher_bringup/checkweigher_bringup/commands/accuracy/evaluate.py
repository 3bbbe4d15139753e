# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the accuracy of the estimators on passes of known mass.

Examples
--------
checkweigher evaluate --protocol paper --html report.html
checkweigher evaluate shift*/ --params machine.yaml --csv accuracy.csv
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import PARAMS, TUNING

_OF_BAGS = 'bags with reference_mass: folders, .mcap files, URLs, or folders that contain bags'
_CLASSES = 'class of OIML R 51: XI, XII, XIII (default), XIIII, Y(I), Y(II), Y(a) or Y(b)'
OPTIONS = (
    'passes',
    ('bags BAG', str, _OF_BAGS, {'nargs': '*'}),
    (
        '--protocol',
        ('paper', 'machines'),
        'simulate passes instead of reading bags, tune on one part of them, and test on the other '
        'part; paper: 5 speeds and 5 masses on the machine of a profile; machines: 3 speeds on '
        'randomly drawn machines, with the attainable accuracy of each machine',
    ),
    (
        '--profile NAME',
        str,
        'machine of the protocol paper: paper (default), roller, soft, floor or quiet',
    ),
    (
        '--passes N',
        int,
        'paper: number of passes of each mass at each speed, half of them for tuning; machines: '
        'number of passes at each speed for tuning, in addition to 120 for the test; default 120',
        120,
    ),
    ('--seed S', int, 'seed of the protocol paper, or of the first machine; default 1', 1),
    ('--count N', int, 'number of machines, with the seeds S, S + 1, ...; default 3', 3),
    (
        '--further N',
        int,
        'machines: number of passes of each machine at each speed for the attainable accuracy; '
        'with fewer passes, it takes less time and is less accurate; default 1500',
        1500,
    ),
    (
        '--without CAUSE',
        [str],
        'causes of disturbance that are removed from the machines: transfer, bounce, rollers, ...',
        [],
    ),
    ('--mass G', [float], 'machines: masses for tuning in g; default: the five masses of the test'),
    'tuning and weighing',
    ('--train BAG', [str], 'bags for tuning; the other bags are then used for the test only'),
    PARAMS,
    *TUNING,
    'limits',
    ('--class CLASS', str, _CLASSES, {'dest': 'accuracy_class', 'default': 'XIII'}),
    ('--factor X', float, 'class factor x: 1, 2 or 5 x 10^k; default 1', 1.0),
    ('--interval G', float, 'verification scale interval e in g; default 0.1 without --max'),
    ('--max G', float, 'Max of the scale in g; e is then the smallest that the class allows'),
    ('--in-service', bool, 'use the limits in service instead of those at initial verification'),
    (
        '--nominal G',
        float,
        'nominal quantity of prepackages in g, whose limits of directive 76/211/EEC are shown in '
        'the HTML report',
    ),
    'output',
    ('--html FILE', Path, 'write a report with tables and figures to FILE'),
    ('--csv FILE', Path, 'write one row for each estimator, speed, mass and part to FILE'),
    ('--json FILE', Path, 'write the results and the error of each pass to FILE'),
    ('--tuned FILE', Path, 'write a parameter file with the tuned parameters to FILE'),
    ('--overwrite', bool, 'replace existing files'),
)


def run(arguments: argparse.Namespace) -> int:
    """Print the table and write the requested files. Return 1 if a bag was skipped, else 0."""
    from checkweigher_bringup.evaluation import evaluate, evaluate_family
    from checkweigher_bringup.settings import on_scheduler_of

    work = evaluate_family if arguments.protocol == 'machines' else evaluate
    with on_scheduler_of(arguments) as n_jobs:
        return int(work(arguments, n_jobs) > 0)
