# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of the checkweigher, one module each: `add_arguments(parser)` and `run(arguments)`.

The modules import what is heavy in `run` alone, so that ``--help`` is there at once. Options that
several commands have are made here.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

Parser = argparse._ActionsContainer


def add_parameter_file(parser: Parser) -> None:
    """Add `--params`."""
    parser.add_argument('--params', type=Path, metavar='FILE', help='ROS parameter file (YAML)')


def add_namespace(parser: Parser) -> None:
    """Add `--namespace`."""
    parser.add_argument('--namespace', default='', metavar='NAME', help='namespace of the lane')


def add_new_bag(parser: Parser) -> None:
    """Add `--output` for a bag."""
    parser.add_argument('--output', type=Path, required=True, metavar='DIR', help='bag to write')


def add_end(parser: Parser, counted: str) -> None:
    """Add `--count` and `--duration`."""
    parser.add_argument('--count', type=int, metavar='N', help=f'end after N {counted}')
    parser.add_argument('--duration', type=float, metavar='S', help='end after S seconds')


def add_bags(parser: Parser, what: str) -> None:
    """Add any number of bags; `what` says what they must have."""
    parser.add_argument(
        'bags', nargs='+', metavar='BAG',
        help=f'{what}: a folder, an .mcap file, a URL such as s3://STORE/BAG, or a folder with '
        'bags in it',
    )  # fmt: skip


def add_scheduling(parser: Parser) -> None:
    """Add how many processes do the work, and where."""
    add = parser.add_argument
    add('--jobs', type=int, metavar='N', help='processes; default one for a core')
    add(
        '--scheduler',
        default='local',
        metavar='ADDRESS',
        help='local, processes of this machine (default), or a Dask cluster: tcp://HOST:8786',
    )


def add_weighing(parser: Parser) -> None:
    """Add the parameters of the weighing, the lane, and the CSV file of the results."""
    add = parser.add_argument
    add_parameter_file(parser)
    add('--estimator', metavar='NAME', help='estimator of the mass; default iswd_eksi')
    add('--lane', metavar='NAME', help='namespace to take, if the bag has several')
    add('--csv', type=Path, metavar='FILE', help='write one row per item to FILE')
    add('--overwrite', action='store_true', help='replace FILE if it exists')


def add_recipe(add: Callable[..., object], what: str) -> None:
    """Add `--recipes` and `--product`; `what` says what the recipe is for."""
    add('--recipes', type=Path, metavar='FILE', help='recipe file')
    add('--product', metavar='NAME', help=f'product of it: {what}')


def add_tuning(parser: Parser) -> None:
    """Add what is tuned, how long, on how many processes and where, and the lane of the bags."""
    add = parser.add_argument
    add('--estimator', nargs='+', action='extend', metavar='NAME',
        help='one or several, or all; the first one is what a tuned file selects; '
        'default of tune the best of all on held-out passes')  # fmt: skip
    add('--budget', type=int, metavar='N',
        help='evaluations of each estimator at each speed; default 240')  # fmt: skip
    add_scheduling(parser)
    add('--lane', metavar='NAME', help='namespace to take, if the bags hold several')
