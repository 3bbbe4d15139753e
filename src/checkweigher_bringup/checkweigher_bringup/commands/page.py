# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the lanes that run in a browser, and act on them with a login."""

import argparse
from pathlib import Path

from checkweigher_web import ADDRESS, PORT


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `page`."""
    add = parser.add_argument
    add('--port', type=int, default=PORT, metavar='N', help=f'default {PORT}')
    add('--namespace', metavar='NAME', help='only this lane')
    add('--users', type=Path, metavar='FILE',
        help='users who may act, of checkweigher user; default that of the command, if there is '
        'one')  # fmt: skip
    add('--host', default=ADDRESS, metavar='ADDRESS',
        help=f'address to serve on; any but {ADDRESS} needs TLS and users')  # fmt: skip
    add('--certificate', type=Path, metavar='FILE', help='certificate for TLS, PEM')
    add('--key', type=Path, metavar='FILE', help='its key, PEM')
    add('--idle', type=float, default=30, metavar='MIN',
        help='a session ends after this time without a click; default 30')  # fmt: skip
    add('--origin', default='', metavar='URL',
        help='https://NAME by which a reverse proxy on this machine serves the page')  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until interrupted."""
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_web.access.site import Site
    from checkweigher_web.server import serve

    given = arguments
    namespace = None if given.namespace is None else check_namespace(given.namespace)
    site = Site(
        given.host, given.port, given.certificate, given.key, given.users, given.origin, given.idle
    )
    serve(site, namespace)
    return 0
