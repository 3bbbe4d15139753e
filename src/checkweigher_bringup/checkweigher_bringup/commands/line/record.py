# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Record a running graph into a bag."""

import argparse

from checkweigher_bringup.commands import add_namespace, add_new_bag
from checkweigher_bringup.errors import UserError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `record`."""
    add_new_bag(parser)
    add_namespace(parser)
    add = parser.add_argument
    add('--duration', type=float, metavar='S', help='end after S seconds; default: at Ctrl-C')
    add('--inputs-only', action='store_true',
        help='leave out windows, estimates and verdicts, which a replay makes again')  # fmt: skip
    add('--reference', type=float, metavar='G',
        help='known mass of every product that passes, for tune and evaluate')  # fmt: skip
    add('--passes', type=int, metavar='N', help='end after N weighed passes of the reference')


def run(arguments: argparse.Namespace) -> int:
    """Record until interrupted; the bag is complete when the command has ended."""
    from checkweigher_bringup.recorder import record
    from checkweigher_bringup.settings import check_namespace, check_positive

    check_positive(arguments, 'reference', 'duration', 'passes')
    if arguments.passes is not None and arguments.reference is None:
        raise UserError('--passes: needs the mass of the product, --reference')
    record(
        arguments.output, check_namespace(arguments.namespace), arguments.duration,
        inputs_only=arguments.inputs_only, passes=arguments.passes,
        reference=None if arguments.reference is None else 0.001 * arguments.reference,
    )  # fmt: skip
    return 0
