# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Convert a CSV log of a scale to a bag.

Examples
--------
checkweigher import log.csv --edges log.edges.json --slope 5.19e-4 --offset -4874.4 --output bag
"""

import argparse
from dataclasses import fields
from pathlib import Path

from checkweigher_bringup.commands import NEW_BAG

# The options have the names of the fields of `ImportParameters`, which defines their defaults. The
# names are repeated here, so that --help does not import `ImportParameters`.
OPTIONS = (
    ('log CSV', Path, 'CSV file with one sample per row'),
    NEW_BAG,
    'columns',
    ('--signal COLUMN', str, 'column of the signal: its name in the header, or number from 0'),
    ('--time COLUMN', str, 'column of the time in s; by default, --sample-rate gives the times'),
    ('--sample-rate HZ', float, 'sample rate in Hz'),
    ('--delimiter D', str, 'delimiter of the columns: , (default) ; tab or space'),
    ('--decimal MARK', str, 'decimal mark: . (default) or ,'),
    'photo-eyes, from two columns or from a file',
    ('--infeed COLUMN', str, 'column of the infeed eye'),
    ('--outfeed COLUMN', str, 'column of the outfeed eye'),
    ('--threshold X', float, 'value above which an eye is blocked (default 0.5)'),
    ('--infeed-key KEY', str, 'key of the infeed eye in the edges file (default ftc1)'),
    ('--outfeed-key KEY', str, 'key of the outfeed eye in the edges file (default ftc2)'),
    ('--blocked-below', bool, 'an eye is blocked below the threshold instead of above it', None),
    (
        '--edges FILE',
        Path,
        'JSON file with a list of [row, level] for each eye, where level 1 means blocked from this '
        'row on; the first pair is the state at the start; "mass_g" may give the true mass',
    ),
    'load cell and calibration: mass = slope * signal + offset, or in counts',
    ('--slope G', float, 'mass in g per unit of the signal'),
    ('--offset G', float, 'mass in g at signal 0'),
    ('--counts-per-kg N', float, 'static sensitivity in counts/kg, instead of --slope'),
    ('--zero-counts N', float, 'reading of the empty belt in counts, instead of --offset'),
    ('--scale X', float, 'counts per unit of the signal (default 1)'),
    ('--min-counts N', int, 'lower limit of the converter in counts'),
    ('--max-counts N', int, 'upper limit of the converter in counts'),
    ('--capacity KG', float, 'capacity of the load cell in kg (default 10)'),
    ('--weigh-length M', float, 'distance between the photo-eyes in m (default 0.2)'),
    ('--model TEXT', str, 'model of the load cell'),
    ('--serial-number TEXT', str, 'serial number of the load cell'),
    ('--samples-per-block N', int, 'number of samples in a message (default 10)'),
    ('--start-time S', int, 'stamp of the first sample in s since 1970'),
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
