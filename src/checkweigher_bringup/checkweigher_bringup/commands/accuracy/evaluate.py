# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the accuracy of the estimators on passes of known mass.

checkweigher evaluate --protocol paper --html report.html
checkweigher evaluate shift*/ --params machine.yaml --csv accuracy.csv
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import PARAMS, TUNING

_OF_BAGS = 'bags with reference_mass: folders, .mcap files, URLs, or folders with bags in them'
_CLASSES = 'of OIML R 51: XI, XII, XIII (default), XIIII, Y(I), Y(II), Y(a) or Y(b)'
OPTIONS = (
    'what is weighed',
    ('bags BAG', str, _OF_BAGS, {'nargs': '*'}),
    (
        '--protocol',
        ('paper', 'machines'),
        'instead of bags simulate, tune on one part of the passes and test on another. paper: '
        '5 speeds x 5 masses on the machine of a profile; machines: 3 speeds on machines drawn '
        'from a family, beside what is attainable on each',
    ),
    ('--profile NAME', str, 'of protocol paper: paper (default), roller, soft, floor or quiet'),
    (
        '--passes N',
        int,
        'paper: of each mass at each speed; machines: at each speed to tune on, 120 others '
        'test; default 120',
        120,
    ),
    ('--seed S', int, 'of the protocol; of the first of the machines', 1),
    ('--count N', int, 'machines, those with the seeds from S on; default 3', 3),
    (
        '--further N',
        int,
        'passes of each machine at each speed that teach what is attainable; fewer are faster '
        'and show less of it; default 1500',
        1500,
    ),
    ('--without CAUSE', [str], 'causes that machines lack: transfer, bounce, rollers, ...', []),
    ('--mass G', [float], 'masses that machines are tuned on, g; default the five that test'),
    'how it is weighed',
    ('--train BAG', [str], 'tune on these bags first; BAG then are the test'),
    PARAMS,
    *TUNING,
    'how it is judged',
    ('--class CLASS', str, _CLASSES, {'dest': 'accuracy_class', 'default': 'XIII'}),
    ('--factor X', float, 'class factor x: 1, 2 or 5 x 10^k', 1.0),
    ('--interval G', float, 'verification scale interval e, g; default 0.1, or by --max'),
    ('--max G', float, 'Max of the scale, g: e is the smallest that the class allows for it'),
    ('--in-service', bool, 'limits in service, not of initial verification'),
    ('--nominal G', float, 'nominal quantity, g: also show limits of EU directive 76/211/EEC'),
    'what is written',
    ('--html FILE', Path, 'report with tables and figures, one file'),
    ('--csv FILE', Path, 'one row for each estimator, speed, mass and part'),
    ('--json FILE', Path, 'the same with every error'),
    ('--tuned FILE', Path, 'parameter file with what was tuned'),
    ('--overwrite', bool, 'replace files that exist'),
)


def run(arguments: argparse.Namespace) -> int:
    """Print the table and write the files. Return 1 if a bag was skipped, otherwise 0."""
    from checkweigher_bringup.evaluation import evaluate, evaluate_family
    from checkweigher_bringup.settings import on_scheduler_of

    work = evaluate_family if arguments.protocol == 'machines' else evaluate
    with on_scheduler_of(arguments) as n_jobs:
        return int(work(arguments, n_jobs) > 0)
