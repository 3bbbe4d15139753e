# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Serve a web page that shows the running lanes, which users can operate after a login.

Examples
--------
checkweigher page --port 8080
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import ESTIMATOR, PARAMS, TLS, USERS
from checkweigher_web import ADDRESS, PORT

if TYPE_CHECKING:
    from checkweigher_web.access.site import Site

OPTIONS = (
    ('--port N', int, f'port of the page; default {PORT}', PORT),
    ('--namespace NAME', str, 'namespace of the only lane to show; default: all lanes'),
    USERS,
    (
        '--host ADDRESS',
        str,
        f'address of the page, by default {ADDRESS}; any other one needs TLS and users',
        ADDRESS,
    ),
    *TLS,
    ('--idle MIN', float, 'time in min after which an unused session ends; default 30', 30),
    ('--origin URL', str, 'https://NAME under which a local reverse proxy serves the page', ''),
    ('--keep DIR', Path, 'folder in which operators and technicians may keep items as bags'),
    ('--trust PUBLIC', Path, 'Ed25519 public key (PEM) to verify the seals of the audit log'),
    'a recording instead of the running lanes',
    ('--bag BAG', Path, 'bag to show'),
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
        refuse(given, 'not with --bag; use checkweigher audit to verify a log', 'trust')
        refuse(given, 'not with --bag; use checkweigher keep to keep an item of a bag', 'keep')
        return _serve_bag(given, site, namespace)
    refuse(given, 'only with --bag', 'params', 'estimator', 'report')
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
            f'--report {given.report}: there is no such file; write it by evaluate --html'
        )
    parameters = line_parameters(given.params, given.estimator, lane)
    recording = read_with_warning(given.bag, lane)
    from checkweigher_web.server import serve_shift
    from checkweigher_web.shift import Shift

    shift = Shift(recording, parameters, given.bag.resolve().name)
    del recording  # Free the memory, because the shift keeps the samples in a file.
    serve_shift(site, shift, given.report)
    return 0
