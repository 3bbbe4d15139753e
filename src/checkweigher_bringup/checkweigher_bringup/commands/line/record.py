# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Record a running line into a bag.

Examples
--------
checkweigher record --output /tmp/shift1 --duration 60
"""

import argparse
import math

from checkweigher_bringup.commands import NAMESPACE, NEW_BAG
from checkweigher_bringup.errors import UserError

_INPUTS = 'do not record windows, estimates and verdicts, which a replay computes again'
OPTIONS = (
    NEW_BAG,
    NAMESPACE,
    ('--duration S', float, 'end after S seconds; default: record until Ctrl-C'),
    ('--inputs-only', bool, _INPUTS),
    ('--reference G', float, 'known mass in g of each product, for tune and evaluate'),
    ('--passes N', int, 'end after N passes of the known mass with a complete window'),
)


def run(arguments: argparse.Namespace) -> int:
    """Record until a signal arrives, or an option ends the recording, and then complete the bag."""
    from checkweigher_bringup.recorder import ReferencePasses, record
    from checkweigher_bringup.settings import check_namespace, check_positive
    from checkweigher_core.records import GRAMS

    check_positive(arguments, 'reference', 'duration', 'passes')
    known = None
    if arguments.reference is not None:
        known = ReferencePasses(arguments.reference / GRAMS, arguments.passes)
    elif arguments.passes is not None:
        raise UserError('--passes: needs the mass of the product, --reference')
    duration, namespace = arguments.duration or math.inf, check_namespace(arguments.namespace)
    record(arguments.output, namespace, duration, inputs_only=arguments.inputs_only, passes=known)
    return 0
