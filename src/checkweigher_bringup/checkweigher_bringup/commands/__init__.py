# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of the checkweigher, and the options that several of them have.

Each command is a module with a table `OPTIONS` and a function `run`, which returns the exit status.
Modules whose import is slow are imported in `run`, so that ``--help`` does not wait for the import.
"""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Option = tuple[Any, ...]  # usage, kind, help and default of an option, see `_add`
REQUIRED = {'required': True}  # argument of `add_argument` for an option that must be given

PARAMS: Option = ('--params FILE', Path, 'ROS parameter file (YAML)')
NAMESPACE: Option = ('--namespace NAME', str, 'namespace of the lane', '')
NEW_BAG: Option = ('--output DIR', Path, 'bag to write', REQUIRED)
ESTIMATOR: Option = (
    '--estimator NAME',
    str,
    'estimator of the mass; default: that of the parameter file, or iswd_eksi',
)
LANE: Option = ('--lane NAME', str, 'namespace of the lane to read if a bag contains several')
OVERWRITE: Option = ('--overwrite', bool, 'replace FILE if it exists')
DURATION: Option = ('--duration S', float, 'end after S seconds')
RECIPES: Option = ('--recipes FILE', Path, 'recipe file')
USERS: Option = (
    '--users FILE',
    Path,
    'file of the users; default: checkweigher/users in $XDG_CONFIG_HOME or ~/.config',
)
# Options for the certificate and the key of the page.
TLS: tuple[Option, ...] = (
    ('--certificate FILE', Path, 'certificate file of the page for TLS (PEM)'),
    ('--key FILE', Path, 'key file of the certificate (PEM)'),
)
# Options for the number of worker processes, and for the cluster on which they run.
SCHEDULING: tuple[Option, ...] = (
    ('--jobs N', int, 'number of processes; default: one for each core'),
    (
        '--scheduler ADDRESS',
        str,
        'local (default), or the address of a Dask scheduler, such as tcp://HOST:8786',
        'local',
    ),
)
CSV: Option = ('--csv FILE', Path, 'write one row per item to FILE')
WEIGHING: tuple[Option, ...] = (PARAMS, ESTIMATOR, LANE, CSV, OVERWRITE)
TUNING: tuple[Option, ...] = (
    (
        '--estimator NAME',
        [str],
        'one or more estimators, or all; the written parameter file selects the first one; by '
        'default, tune selects the best one on held-out passes',
    ),
    (
        '--budget N',
        int,
        'largest number of evaluations of each estimator at each speed; default 240',
        240,
    ),
    *SCHEDULING,
    LANE,
)


def bags(text: str) -> Option:
    """Return the definition of a positional argument for one or more bags.

    The help text of the argument begins with `text`.
    """
    where = 'a folder, an .mcap file, a URL such as s3://STORE/BAG, or a folder that contains bags'
    return 'bags BAG', [str], f'{text}: {where}'


def add_options(parser: argparse.ArgumentParser, options: Iterable[Any]) -> None:
    """Add options to a parser.

    A string in `options` is the title of the options that follow. The user may give only one of the
    options in an inner tuple.
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
    """Add an option or a positional argument to a group.

    `usage` is the name of the option (or several, with commas) and, after a space, the name of its
    value. `kind` is the type of the value, a list with the type for one or more values, a tuple of
    the allowed values, or bool for a flag. `more` may contain a default, or a dict of further
    keywords of `add_argument`.
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
    group.add_argument(*name.split(','), help=text, **values)
