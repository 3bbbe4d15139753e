# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Turn a CSV log of a scale into a bag."""

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

from checkweigher_bringup.commands import add_new_bag

# Option, what converts it, metavar, help; the names are those of ImportParameters, whose
# defaults hold. Written out, so that --help needs no imports.
_COLUMNS: tuple[tuple[str, Any, str, str], ...] = (
    ('signal', str, 'COLUMN', 'signal: name in the header row, or number from 0'),
    ('time', str, 'COLUMN', 'time in s; without it the rows count by --sample-rate'),
    ('sample-rate', float, 'HZ', 'samples a second'),
    ('delimiter', str, 'D', 'between columns: , (default) ; tab or space'),
    ('decimal', str, 'MARK', 'decimal mark: . (default) or ,'),
)
_EYES: tuple[tuple[str, Any, str, str], ...] = (
    ('infeed', str, 'COLUMN', 'infeed eye'),
    ('outfeed', str, 'COLUMN', 'outfeed eye'),
    ('threshold', float, 'X', 'an eye is blocked above this value (default 0.5)'),
    ('infeed-key', str, 'KEY', 'infeed eye in the edges file (default ftc1)'),
    ('outfeed-key', str, 'KEY', 'outfeed eye in the edges file (default ftc2)'),
)
_CALIBRATION: tuple[tuple[str, Any, str, str], ...] = (
    ('slope', float, 'G', 'g per unit of the signal'),
    ('offset', float, 'G', 'mass in g at signal 0'),
    ('counts-per-kg', float, 'N', 'static sensitivity, instead of --slope'),
    ('zero-counts', float, 'N', 'reading of the empty belt, instead of --offset'),
    ('scale', float, 'X', 'counts per unit of the signal (default 1)'),
    ('min-counts', int, 'N', 'lower limit of the converter'),
    ('max-counts', int, 'N', 'upper limit of the converter'),
    ('capacity', float, 'KG', 'of the load cell (default 10)'),
    ('weigh-length', float, 'M', 'from the infeed eye to the outfeed eye (default 0.2)'),
    ('model', str, 'TEXT', 'of the load cell'),
    ('serial-number', str, 'TEXT', 'of the load cell'),
    ('samples-per-block', int, 'N', 'samples in one message (default 10)'),
    ('start-time', int, 'S', 'stamp of the first sample, since 1970'),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `import`."""
    parser.add_argument('log', type=Path, metavar='CSV', help='one sample a row')
    add_new_bag(parser)
    for title, options in (
        ('columns', _COLUMNS),
        ('photo-eyes, from two columns or from a file', _EYES),
        ('load cell and calibration: mass = slope * signal + offset, or in counts', _CALIBRATION),
    ):
        group = parser.add_argument_group(title)
        for name, convert, metavar, text in options:
            group.add_argument(f'--{name}', type=convert, metavar=metavar, help=text)
        if options is _EYES:
            group.add_argument('--blocked-below', action='store_true', default=None,
                               help='an eye is blocked below the threshold')  # fmt: skip
            group.add_argument(
                '--edges', type=Path, metavar='FILE',
                help='JSON with a list of [row, level] for each eye: 1 is blocked from that row '
                'on, the first entry is the state at the start; "mass_g" may give the true mass',
            )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Read the log and write the bag."""
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
