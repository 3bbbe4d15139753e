# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Write a complete bag from a recording that broke off.

Examples
--------
checkweigher recover shift1 --output shift1_whole
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import NEW_BAG

OPTIONS = (('bag BAG', Path, 'folder without metadata.yaml, or truncated .mcap file'), NEW_BAG)


def run(arguments: argparse.Namespace) -> int:
    """Write a complete bag, and leave the damaged recording unchanged."""
    from checkweigher_recording.bags.recovery import recover_bag

    print(f'{arguments.output}: {recover_bag(arguments.bag, arguments.output)} messages')
    return 0
