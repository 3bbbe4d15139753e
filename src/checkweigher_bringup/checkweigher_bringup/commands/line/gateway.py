# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run a gateway between the running lanes and the plant.

Examples
--------
checkweigher gateway metrics --settings gateways.yaml
"""

import argparse
from pathlib import Path

from checkweigher_gateways import KINDS

OPTIONS = (
    ('kind', KINDS, f'kind of gateway: {", ".join(KINDS)}'),
    ('--settings FILE', Path, 'settings file of the gateways (YAML)'),
    ('--namespace NAME', str, 'namespace of the only lane to serve; default: all lanes'),
)


def run(given: argparse.Namespace) -> int:
    """Run the gateway until a signal interrupts the command."""
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_gateways.gateway import serve
    from checkweigher_gateways.settings import read_gateways

    namespace = None if given.namespace is None else check_namespace(given.namespace)
    serve(given.kind, read_gateways(given.settings), namespace)
    return 0
