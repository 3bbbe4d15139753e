# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Turn a CSV log of a scale into a bag.

checkweigher import log.csv --edges log.edges.json --slope 5.19e-4 --offset -4874.4 --output bag
"""

import argparse
from dataclasses import fields
from pathlib import Path

from checkweigher_bringup.commands import NEW_BAG

# The names of the options are those of `ImportParameters`, which has their defaults. The names are
# repeated here, so that --help does not import `ImportParameters`.
OPTIONS = (
    ('log CSV', Path, 'one sample a row'),
    NEW_BAG,
    'columns',
    ('--signal COLUMN', str, 'signal: name in the header row, or number from 0'),
    ('--time COLUMN', str, 'time in s; without it the rows count by --sample-rate'),
    ('--sample-rate HZ', float, 'samples a second'),
    ('--delimiter D', str, 'between columns: , (default) ; tab or space'),
    ('--decimal MARK', str, 'decimal mark: . (default) or ,'),
    'photo-eyes, from two columns or from a file',
    ('--infeed COLUMN', str, 'infeed eye'),
    ('--outfeed COLUMN', str, 'outfeed eye'),
    ('--threshold X', float, 'an eye is blocked above this value (default 0.5)'),
    ('--infeed-key KEY', str, 'infeed eye in the edges file (default ftc1)'),
    ('--outfeed-key KEY', str, 'outfeed eye in the edges file (default ftc2)'),
    ('--blocked-below', bool, 'an eye is blocked below the threshold', None),
    (
        '--edges FILE',
        Path,
        'JSON with a list of [row, level] for each eye: 1 is blocked from that row on, the first '
        'entry is the state at the start; "mass_g" may give the true mass',
    ),
    'load cell and calibration: mass = slope * signal + offset, or in counts',
    ('--slope G', float, 'g per unit of the signal'),
    ('--offset G', float, 'mass in g at signal 0'),
    ('--counts-per-kg N', float, 'static sensitivity, instead of --slope'),
    ('--zero-counts N', float, 'reading of the empty belt, instead of --offset'),
    ('--scale X', float, 'counts per unit of the signal (default 1)'),
    ('--min-counts N', int, 'lower limit of the converter'),
    ('--max-counts N', int, 'upper limit of the converter'),
    ('--capacity KG', float, 'of the load cell (default 10)'),
    ('--weigh-length M', float, 'from the infeed eye to the outfeed eye (default 0.2)'),
    ('--model TEXT', str, 'of the load cell'),
    ('--serial-number TEXT', str, 'of the load cell'),
    ('--samples-per-block N', int, 'samples in one message (default 10)'),
    ('--start-time S', int, 'stamp of the first sample, since 1970'),
)


def run(arguments: argparse.Namespace) -> int:
    """Convert a CSV log to a bag."""
    from checkweigher_core.whole_file import check_new
    from checkweigher_recording.bags.writing import write_bag
    from checkweigher_recording.csv.log_import import ImportParameters, import_csv

    names = {entry.name for entry in fields(ImportParameters)}
    given = {n: value for n, value in vars(arguments).items() if n in names and value is not None}
    check_new(arguments.output)
    recording = import_csv(arguments.log, ImportParameters.from_mapping(given), arguments.edges)
    write_bag(arguments.output, recording.load_cell, recording)
    samples = sum(len(block.counts) for block in recording.blocks)
    print(
        f'{arguments.output}: {samples} samples at {recording.load_cell.sample_rate:g} Hz, '
        f'{len(recording.edges)} edges, {len(recording.references)} known masses'
    )
    return 0
