# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Make a self-signed certificate for the page."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `certificate`."""
    add = parser.add_argument
    add('names', nargs='+', metavar='NAME',
        help='host name or address by which browsers open the page')  # fmt: skip
    add('--certificate', type=Path, required=True, metavar='FILE', help='to write')
    add('--key', type=Path, required=True, metavar='FILE', help='to write, for the owner alone')


def run(arguments: argparse.Namespace) -> int:
    """Write certificate and key."""
    from checkweigher_web.access.certificate import make_certificate

    print(make_certificate(arguments.names, arguments.certificate, arguments.key))
    return 0
