# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibrate the load cell with known masses at rest, or the line with passes of a known mass."""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import add_namespace


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `calibrate`."""
    wanted = parser.add_mutually_exclusive_group(required=True)
    add = wanted.add_argument
    add('--masses', type=float, nargs='+', metavar='G', help='known masses, in the order of use')
    add('--zero', action='store_true', help='read the empty belt only, and keep the sensitivity')
    add('--dynamic', action='store_true',
        help='record passes of --reference at each of --speeds, and train on them')  # fmt: skip
    add = parser.add_argument
    add('--output', type=Path, required=True, metavar='FILE',
        help='parameter file; one that is there is kept as an older version')  # fmt: skip
    add('--source', metavar='NAME',
        help='source whose calibration it is, such as aed; not with --dynamic')  # fmt: skip
    add('--open', action='store_true',
        help='open the source; without, the samples are those of a running line')  # fmt: skip
    add('--params', type=Path, metavar='FILE',
        help='parameters of the source, which go into the new file as well')  # fmt: skip
    add_namespace(parser)
    add('--mass-uncertainty', type=float, default=0.0, metavar='G',
        help='standard uncertainty of each mass')  # fmt: skip
    add('--duration', type=float, default=5.0, metavar='S', help='for which each mass is read')
    add('--tolerance', type=float, default=0.1, metavar='G',
        help='by which a load at rest may still move')  # fmt: skip
    add('--max-residual', type=float, metavar='G',
        help='write nothing if a mass is further off the line')  # fmt: skip
    add = parser.add_argument_group('dynamic setting').add_argument
    add('--reference', type=float, metavar='G', help='mass of all that passes')
    add('--passes', type=int, metavar='N', default=60, help='at each speed; default 60')
    add('--speeds', type=float, nargs='+', metavar='M_PER_MIN', help='belt speeds, in turn')
    add('--bags', type=Path, metavar='DIR', help='folder for the bags; default OUTPUT_passes')
    add('--estimator', metavar='NAME', help='what is trained; default the best of all')
    add('--budget', type=int, metavar='N', help='as that of tune')


def run(arguments: argparse.Namespace) -> int:
    """Guide through the masses or the speeds, and write the file."""
    if arguments.dynamic:
        from checkweigher_bringup.commissioning.dynamic_guide import set_dynamically

        set_dynamically(arguments)
    else:
        from checkweigher_bringup.commissioning.static_guide import calibrate_at_rest

        calibrate_at_rest(arguments)
    return 0
