"""Show masses and verdicts of a running graph as they come."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `echo`."""
    parser.add_argument('--namespace', default='', metavar='NAME', help='namespace of the lane')
    parser.add_argument('--count', type=int, metavar='N', help='end after N verdicts')
    parser.add_argument('--duration', type=float, metavar='S', help='end after S seconds')


def run(arguments: argparse.Namespace) -> int:
    """Show one line a verdict until interrupted."""
    from checkweigher_bringup.listening import echo
    from checkweigher_bringup.settings import check_namespace, check_positive

    echo(
        check_namespace(arguments.namespace),
        check_positive('--count', arguments.count),
        check_positive('--duration', arguments.duration),
    )
    return 0
