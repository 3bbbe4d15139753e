# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Show the running lanes in a browser, and act on them with a login.

checkweigher page --port 8080
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import ESTIMATOR, PARAMS
from checkweigher_web import ADDRESS, PORT

if TYPE_CHECKING:
    from checkweigher_web.access.site import Site

OPTIONS = (
    ('--port N', int, f'default {PORT}', PORT),
    ('--namespace NAME', str, 'only this lane'),
    ('--users FILE', Path, 'users who may act; default the file of checkweigher user'),
    ('--host ADDRESS', str, f'served address; any but {ADDRESS} needs TLS and users', ADDRESS),
    ('--certificate FILE', Path, 'certificate for TLS, PEM'),
    ('--key FILE', Path, 'its key, PEM'),
    ('--idle MIN', float, 'a session ends after this time without a click; default 30', 30),
    ('--origin URL', str, 'https://NAME by which a local reverse proxy serves the page', ''),
    ('--keep DIR', Path, 'folder in which operators and technicians may keep items as bags'),
    ('--trust PUBLIC', Path, 'Ed25519 public key (PEM) to verify the seals of the audit log'),
    'a recording in place of the lanes that run',
    ('--bag BAG', Path, 'show a recorded shift'),
    PARAMS,
    ESTIMATOR,
    ('--report FILE', Path, 'HTML report of evaluate that the page links to'),
)


def run(given: argparse.Namespace) -> int:
    """Serve the page until a signal interrupts the command."""
    from checkweigher_bringup.settings import check_namespace, refuse
    from checkweigher_core.whole_file import check_folder_of
    from checkweigher_web.access.site import Site

    namespace = None if given.namespace is None else check_namespace(given.namespace)
    site = Site(
        given.host, given.port, given.certificate, given.key, given.users, given.origin, given.idle
    )
    if given.bag is not None:
        refuse(given, 'of a running line only; for its log there is checkweigher audit', 'trust')
        refuse(given, 'of a running line only; for a bag there is checkweigher keep', 'keep')
        return _serve_bag(given, site, namespace)
    refuse(given, 'goes with --bag only', 'params', 'estimator', 'report')
    if given.keep is not None:
        check_folder_of(given.keep / 'item')
    from checkweigher_production.audit_seal import public_key
    from checkweigher_web.server import serve

    serve(site, namespace, given.keep, given.trust and public_key(given.trust))
    return 0


def _serve_bag(given: argparse.Namespace, site: 'Site', lane: str | None) -> int:
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.output import read_with_warning
    from checkweigher_bringup.settings import line_parameters

    if given.report is not None and not given.report.is_file():
        raise UserError(
            f'--report {given.report}: there is no such file; evaluate --html writes it'
        )
    parameters = line_parameters(given.params, given.estimator, lane)
    recording = read_with_warning(given.bag, lane)
    from checkweigher_web.server import serve_shift
    from checkweigher_web.shift import Shift

    shift = Shift(recording, parameters, given.bag.resolve().name)
    del recording  # The shift has the samples in a file, so they need no memory.
    serve_shift(site, shift, given.report)
    return 0
