# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the lanes that run in a browser on this machine."""

import argparse

from checkweigher_web import PORT


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `page`."""
    parser.add_argument('--port', type=int, default=PORT, metavar='N',
                        help=f'on the loopback address; default {PORT}')  # fmt: skip
    parser.add_argument('--namespace', metavar='NAME', help='only this lane')


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until interrupted."""
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_web.server import serve

    namespace = None if arguments.namespace is None else check_namespace(arguments.namespace)
    serve(namespace, arguments.port)
    return 0
