# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the lanes that run in a browser, and act on them with a login."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import add_parameter_file
from checkweigher_web import ADDRESS, PORT

if TYPE_CHECKING:
    from checkweigher_web.access.site import Site


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
    add('--keep', type=Path, metavar='DIR',
        help='folder to which operators and technicians may keep items, each as a bag')  # fmt: skip
    add('--trust', type=Path, metavar='PUBLIC',
        help='hold the audit log against LOG.seals by this Ed25519 public key (PEM)')  # fmt: skip
    recording = parser.add_argument_group('a recording in place of the lanes that run')
    add = recording.add_argument
    add('--bag', type=Path, metavar='BAG', help='show a recorded shift')
    add_parameter_file(recording)
    add('--estimator', metavar='NAME', help='estimator of the mass; default iswd_eksi')
    add('--report', type=Path, metavar='FILE',
        help='HTML report of evaluate that the page links to')  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until interrupted."""
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_core.whole_file import check_folder_of
    from checkweigher_web.access.site import Site

    given = arguments
    namespace = None if given.namespace is None else check_namespace(given.namespace)
    site = Site(
        given.host, given.port, given.certificate, given.key, given.users, given.origin, given.idle
    )
    if given.trust is not None and given.bag is not None:
        raise UserError('--trust: of a running line only; for its log there is checkweigher audit')
    if given.keep is not None:
        if given.bag is not None:
            raise UserError('--keep: of a running line only; for a bag there is checkweigher keep')
        check_folder_of(given.keep / 'item')
    if given.bag is not None:
        return _serve_bag(given, site, namespace)
    for name in ('params', 'estimator', 'report'):
        if getattr(given, name) is not None:
            raise UserError(f'--{name}: goes with --bag only')
    from checkweigher_production.audit_seal import public_key
    from checkweigher_web.server import serve

    serve(site, namespace, given.keep, given.trust and public_key(given.trust))
    return 0


def _serve_bag(given: argparse.Namespace, site: 'Site', lane: str | None) -> int:
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.output import print_warning
    from checkweigher_bringup.settings import line_parameters
    from checkweigher_recording.bags.reading import read_bag

    if given.report is not None and not given.report.is_file():
        raise UserError(
            f'--report {given.report}: there is no such file; evaluate --html writes it'
        )
    parameters = line_parameters(given.params, given.estimator, lane)
    recording = read_bag(given.bag, lane, progress=True)
    print_warning(recording)
    from checkweigher_web.server import serve_shift
    from checkweigher_web.shift import Shift

    shift = Shift(recording, parameters)
    del recording  # its samples are in a file now
    serve_shift(site, shift, given.bag.resolve().name, given.report)
    return 0
