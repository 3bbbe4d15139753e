# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run a gateway into the plant for the lanes that run.

checkweigher gateway metrics --settings gateways.yaml
"""

import argparse
from pathlib import Path

from checkweigher_gateways import KINDS

OPTIONS = (
    ('kind', KINDS, f'one of {", ".join(KINDS)}'),
    ('--settings FILE', Path, 'settings of the gateways (YAML)'),
    ('--namespace NAME', str, 'only this lane'),
)


def run(given: argparse.Namespace) -> int:
    """Run the gateway until interrupted."""
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_gateways.gateway import serve
    from checkweigher_gateways.settings import read_gateways

    namespace = None if given.namespace is None else check_namespace(given.namespace)
    serve(given.kind, read_gateways(given.settings), namespace)
    return 0
