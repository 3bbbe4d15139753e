# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Write one item of a bag into a small bag, which can be sent with a bug report.

Examples
--------
checkweigher keep shift1 --item 17 --output item17
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import ESTIMATOR, LANE, NEW_BAG, PARAMS, REQUIRED

OPTIONS = (
    ('bag BAG', Path, 'folder of a bag, or an .mcap file'),
    ('--item N', int, 'number of the item, as weigh shows it', REQUIRED),
    NEW_BAG,
    PARAMS,
    ESTIMATOR,
    LANE,
)


def run(arguments: argparse.Namespace) -> int:
    """Write the item into a new bag, and print the result of weighing that bag."""
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.output import ItemTable, read_with_warning
    from checkweigher_bringup.settings import line_parameters
    from checkweigher_core.whole_file import check_new
    from checkweigher_recording.bags.writing import write_bag
    from checkweigher_validation.accuracy.results import weigh
    from checkweigher_validation.item_recording import keep_item

    parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
    check_new(arguments.output)
    recording = read_with_warning(arguments.bag, arguments.lane)
    results = weigh(recording, parameters, progress=True)
    found = [each for each in results if each.estimate.item_id == arguments.item]
    if not found:
        raise UserError(f'--item {arguments.item}: {arguments.bag} has items 1..{len(results)}')
    part, result = keep_item(recording, parameters, found[0].estimate, found[0].verdict)
    write_bag(arguments.output, part.load_cell, part, arguments.lane or '')
    ItemTable(part.blocks[0].stamp).show(result)
    print(
        f'{arguments.output}: item {arguments.item} of {arguments.bag} is item '
        f'{result.estimate.item_id} of this bag'
    )
    return 0
