# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of the checkweigher. Each is a module with a table `OPTIONS` and `run(arguments)`.

Heavy imports are in `run`, so that ``--help`` does not wait for them. Options of several commands
are defined here.
"""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

# Usage, kind, help and optional default of an option; see `_add`.
Option = tuple[Any, ...]
REQUIRED = {'required': True}  # in place of a default

PARAMS: Option = ('--params FILE', Path, 'ROS parameter file (YAML)')
NAMESPACE: Option = ('--namespace NAME', str, 'namespace of the lane', '')
NEW_BAG: Option = ('--output DIR', Path, 'bag to write', REQUIRED)
ESTIMATOR: Option = ('--estimator NAME', str, 'estimator of the mass; default iswd_eksi')
LANE: Option = ('--lane NAME', str, 'namespace to take, if the bag has several')
OVERWRITE: Option = ('--overwrite', bool, 'replace FILE if it exists')
DURATION: Option = ('--duration S', float, 'end after S seconds')
RECIPES: Option = ('--recipes FILE', Path, 'recipe file')
# Number and place of the processes that do the work.
SCHEDULING: tuple[Option, ...] = (
    ('--jobs N', int, 'processes; default one for a core'),
    ('--scheduler ADDRESS', str, 'local (default), or a Dask cluster: tcp://HOST:8786', 'local'),
)
# Parameters of the weighing, the lane, and the CSV file of the results.
CSV: Option = ('--csv FILE', Path, 'write one row per item to FILE')
WEIGHING: tuple[Option, ...] = (PARAMS, ESTIMATOR, LANE, CSV, OVERWRITE)
# Estimators, budget and processes of the tuning, and the lane of the bags.
TUNING: tuple[Option, ...] = (
    (
        '--estimator NAME',
        [str],
        'one or several, or all; the first one is what a tuned file selects; default of tune the '
        'best of all on held-out passes',
    ),
    ('--budget N', int, 'evaluations of each estimator at each speed; default 240', 240),
    *SCHEDULING,
    ('--lane NAME', str, 'namespace to take, if the bags hold several'),
)


def bags(text: str) -> Option:
    """Return the argument for one or more bags, which `text` describes."""
    where = 'a folder, an .mcap file, a URL such as s3://STORE/BAG, or a folder with bags in it'
    return 'bags BAG', [str], f'{text}: {where}'


def add_options(parser: argparse.ArgumentParser, options: Iterable[Any]) -> None:
    """Add options to a parser.

    A string among them is the title of the options after it. Options in a tuple exclude each other.
    """
    group: argparse._ActionsContainer = parser
    for option in options:
        if isinstance(option, str):
            group = parser.add_argument_group(option)
        elif isinstance(option[0], tuple):
            alternatives = parser.add_mutually_exclusive_group()
            for each in option:
                _add(alternatives, *each)
        else:
            _add(group, *option)


def _add(group: argparse._ActionsContainer, usage: str, kind: Any, text: str, *more: Any) -> None:
    """Add an option or an argument.

    `usage` is its name and, after a space, the name of its value. `kind` is the type of the value,
    a list with that type for one or more values, a tuple of the choices, or bool for a flag. `more`
    may have a default, or a dict of further keywords of `add_argument`.
    """
    name, _, metavar = usage.partition(' ')
    values: dict[str, Any] = {'type': kind, 'metavar': metavar}
    if kind is bool:
        values = {'action': 'store_true'}
    elif isinstance(kind, tuple):
        values = {'choices': kind}
    elif isinstance(kind, list):
        values |= {'type': kind[0], 'nargs': '+', 'action': 'extend'}
    for each in more:
        values |= each if isinstance(each, dict) else {'default': each}
    group.add_argument(name, help=text, **values)
