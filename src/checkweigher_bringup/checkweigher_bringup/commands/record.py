"""Record a running graph into a bag."""

import argparse

from checkweigher_bringup.commands import add_namespace, add_new_bag


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `record`."""
    add_new_bag(parser)
    add_namespace(parser)
    parser.add_argument(
        '--duration', type=float, metavar='S', help='end after S seconds; default: at Ctrl-C'
    )
    parser.add_argument(
        '--inputs-only', action='store_true',
        help='leave out windows, estimates and verdicts, which a replay makes again',
    )  # fmt: skip
    parser.add_argument(
        '--reference', type=float, metavar='G',
        help='known mass of every product that passes, for tune and evaluate',
    )  # fmt: skip
    parser.add_argument(
        '--passes', type=int, metavar='N', help='end after N weighed passes of the reference'
    )


def run(arguments: argparse.Namespace) -> int:
    """Record until interrupted; the bag is complete when the command has ended."""
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.recorder import record
    from checkweigher_bringup.settings import check_namespace, check_positive

    check_positive(arguments, 'reference', 'duration', 'passes')
    if arguments.passes is not None and arguments.reference is None:
        raise UserError('--passes: needs the mass of the product, --reference')
    record(
        arguments.output, check_namespace(arguments.namespace), arguments.duration,
        inputs_only=arguments.inputs_only,
        reference=None if arguments.reference is None else 0.001 * arguments.reference,
        passes=arguments.passes,
    )  # fmt: skip
    return 0
