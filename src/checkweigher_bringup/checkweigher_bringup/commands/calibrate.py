"""Calibrate the load cell with known masses at rest, or the line with passes of a known mass."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import add_namespace

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from checkweigher_bringup.commissioning.sample_feed import SampleFeed
    from checkweigher_driver.calibration.static_calibration import (
        CalibrationPoint,
        StaticCalibration,
    )
    from checkweigher_dsp.records import LoadCell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `calibrate`."""
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument(
        '--masses', type=float, nargs='+', metavar='G', help='known masses, in the order of use'
    )
    wanted.add_argument(
        '--zero', action='store_true', help='read the empty belt only, and keep the sensitivity'
    )
    wanted.add_argument(
        '--dynamic', action='store_true',
        help='record passes of --reference at each of --speeds, and train on them',
    )  # fmt: skip
    parser.add_argument(
        '--output', type=Path, required=True, metavar='FILE',
        help='parameter file; one that is there is kept as an older version',
    )  # fmt: skip
    parser.add_argument(
        '--source', metavar='NAME',
        help='source whose calibration it is, such as aed; not with --dynamic',
    )  # fmt: skip
    parser.add_argument(
        '--open', action='store_true',
        help='open the source; without, the samples are those of a running line',
    )  # fmt: skip
    parser.add_argument(
        '--params', type=Path, metavar='FILE',
        help='parameters of the source, which go into the new file as well',
    )  # fmt: skip
    add_namespace(parser)
    parser.add_argument(
        '--mass-uncertainty', type=float, default=0.0, metavar='G',
        help='standard uncertainty of each mass',
    )  # fmt: skip
    parser.add_argument(
        '--duration', type=float, default=5.0, metavar='S', help='for which each mass is read'
    )
    parser.add_argument(
        '--tolerance', type=float, default=0.1, metavar='G',
        help='by which a load at rest may still move',
    )  # fmt: skip
    parser.add_argument(
        '--max-residual', type=float, metavar='G',
        help='write nothing if a mass is further off the line',
    )  # fmt: skip
    dynamic = parser.add_argument_group('dynamic setting')
    dynamic.add_argument('--reference', type=float, metavar='G', help='mass of all that passes')
    dynamic.add_argument(
        '--passes', type=int, metavar='N', default=60, help='at each speed; default 60'
    )
    dynamic.add_argument(
        '--speeds', type=float, nargs='+', metavar='M_PER_MIN', help='belt speeds, in turn'
    )
    dynamic.add_argument(
        '--bags', type=Path, metavar='DIR', help='folder for the bags; default OUTPUT_passes'
    )
    dynamic.add_argument('--estimator', metavar='NAME', default='iswd_eksi', help='what is trained')
    dynamic.add_argument('--budget', type=int, metavar='N', help='as that of tune')


def run(arguments: argparse.Namespace) -> int:
    """Guide through the masses and write the file."""
    if arguments.dynamic:
        from checkweigher_bringup.commissioning.dynamic_guide import set_dynamically

        set_dynamically(arguments)
        return 0
    from checkweigher_bringup.commissioning.static_guide import guided_points
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.settings import check_positive
    from checkweigher_driver.calibration.file import (
        calibration_table,
        check_calibration_file,
        write_version,
    )
    from checkweigher_driver.calibration.static_calibration import Steadiness

    if arguments.source is None:
        raise UserError('--source: must name the source whose calibration it is, such as aed')
    masses = [0.001 * mass for mass in arguments.masses or ()]
    for option, values in (
        ('--masses', arguments.masses or ()),
        ('--duration', [arguments.duration]),
        ('--tolerance', [arguments.tolerance]),
        ('--max-residual', [arguments.max_residual]),
    ):
        for value in values:
            check_positive(option, value)
    if not arguments.mass_uncertainty >= 0:
        raise UserError(f'--mass-uncertainty {arguments.mass_uncertainty}: must not be negative')
    check_calibration_file(arguments.output)
    with _feed(arguments) as feed:
        load_cell = feed.wait_for_load_cell()
        points = guided_points(
            feed, masses, 0.001 * arguments.mass_uncertainty,
            Steadiness(arguments.duration, 0.001 * arguments.tolerance),
        )  # fmt: skip
    found = _calibration(points, load_cell)
    print('\n'.join(calibration_table(found, points)))
    if arguments.max_residual and found.largest_residual > 0.001 * arguments.max_residual:
        raise UserError(
            f'{arguments.output}: not written: a mass is {1000 * found.largest_residual:.3f} g off '
            f'the line, more than --max-residual {arguments.max_residual:g}; check the masses, '
            'and what touches the belt'
        )
    version = write_version(arguments.output, arguments.source, found, points, arguments.params)
    print(f'{arguments.output}: version {version} written; start the line with it')
    return 0


def _calibration(points: 'list[CalibrationPoint]', load_cell: 'LoadCell') -> 'StaticCalibration':
    from checkweigher_driver.calibration.static_calibration import calibrate, zero_only

    if len(points) > 1:
        return calibrate(points)
    return zero_only(points[0], load_cell.counts_per_kg)


def _feed(arguments: argparse.Namespace) -> 'AbstractContextManager[SampleFeed]':
    """Return where the samples come from."""
    from checkweigher_bringup.commissioning.sample_feed import line_feed, source_feed
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_driver.calibration.file import check_calibrated_source, source_values
    from checkweigher_driver.devices import source_class

    check_calibrated_source(arguments.source)
    if not arguments.open:
        return line_feed(check_namespace(arguments.namespace))
    values: dict[str, object] = {}
    if arguments.params is not None:
        values = source_values(arguments.params, arguments.source)
    kind = source_class(arguments.source)
    return source_feed(arguments.source, kind(kind.parameters.from_mapping(values)))
