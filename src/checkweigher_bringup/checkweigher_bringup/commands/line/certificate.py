# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Make a self-signed certificate for the page, and show its fingerprint.

Examples
--------
checkweigher certificate scale7.local 192.168.1.7 --certificate page.crt --key page.key
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import REQUIRED

OPTIONS = (
    ('names NAME', [str], 'host name or IP address in the address of the page'),
    ('--certificate FILE', Path, 'certificate file to write', REQUIRED),
    ('--key FILE', Path, 'key file to write, which only its owner can read', REQUIRED),
)


def run(arguments: argparse.Namespace) -> int:
    """Write the certificate and its key, and print the fingerprint."""
    from checkweigher_web.access.certificate import make_certificate

    print(make_certificate(arguments.names, arguments.certificate, arguments.key))
    return 0
