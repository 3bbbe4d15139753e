"""Show what is wrong with a running line, worst first, and what to check."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `status`."""
    parser.add_argument('--namespace', default='', metavar='NAME', help='only this lane')
    parser.add_argument('--count', type=int, metavar='N', help='end after N tables, one a second')
    parser.add_argument('--duration', type=float, metavar='S', help='end after S seconds')
    parser.add_argument(
        '--values', action='store_true', help='show the figures of what is well, too'
    )


def run(arguments: argparse.Namespace) -> int:
    """Show tables until interrupted; 1 if the last one has an error or a silent node."""
    from checkweigher_bringup.settings import check_namespace, check_positive
    from checkweigher_bringup.watching import watch

    well = watch(
        check_namespace(arguments.namespace),
        check_positive('--count', arguments.count),
        check_positive('--duration', arguments.duration),
        values=arguments.values,
    )
    return 0 if well else 1
