# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Static calibration at the terminal: a technician puts known masses on the belt at rest."""

import argparse
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager

from checkweigher_bringup.commissioning.sample_feed import SampleFeed, line_feed, source_feed
from checkweigher_bringup.commissioning.terminal import ask, show
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.settings import check_namespace, check_positive
from checkweigher_core.records import GRAMS, LoadCell
from checkweigher_driver.calibration.file import (
    calibrated_sources,
    calibration_table,
    check_calibrated_source,
    check_calibration_file,
    source_values,
    write_version,
)
from checkweigher_driver.calibration.static_calibration import (
    CalibrationPoint,
    RestReading,
    StaticReading,
    Steadiness,
    calibrate,
    zero_only,
)
from checkweigher_driver.devices import source_class

_DURATION = 5.0  # default duration in s of each reading
_TOLERANCE = 0.1  # default limit in g of the drift of a reading


def check_masses(arguments: argparse.Namespace) -> None:
    """Raise `UserError` if a mass, its uncertainty or the largest residual is invalid."""
    check_positive(arguments, 'masses', 'max_residual')
    if not arguments.mass_uncertainty >= 0:
        raise UserError(f'--mass-uncertainty {arguments.mass_uncertainty}: must not be negative')


def calibrate_at_rest(arguments: argparse.Namespace) -> None:
    """Guide the technician through a calibration, and write the calibration file.

    Raises `UserError` if an option is not valid, the samples or the standard input end, or the
    largest residual is above the limit. Raises `CalibrationError` if the source has no calibration
    parameters, if the file is not a calibration file or lies in an installed package, and as
    `read_at_rest` and `calibrate` do. After an exception, the file is unchanged.
    """
    if arguments.source is None:
        names = ', '.join(calibrated_sources())
        raise UserError(f'--source: must be the source to calibrate: {names}')
    check_masses(arguments)
    check_positive(arguments, 'duration', 'tolerance')
    check_calibration_file(arguments.output)
    masses = [mass / GRAMS for mass in arguments.masses or ()]
    with _feed(arguments) as feed:
        load_cell = feed.wait_for_load_cell()
        duration, tolerance = arguments.duration or _DURATION, arguments.tolerance or _TOLERANCE
        steadiness = Steadiness(duration, tolerance / GRAMS)
        points = _guided_points(feed, masses, arguments.mass_uncertainty / GRAMS, steadiness)
    found = calibrate(points) if masses else zero_only(points[0], load_cell.counts_per_kg)
    print('\n'.join(calibration_table(found, points)))
    residual = GRAMS * found.largest_residual
    if arguments.max_residual and residual > arguments.max_residual:
        raise UserError(
            f'{arguments.output}: not written: the largest residual is {residual:.3f} g, more than '
            f'--max-residual {arguments.max_residual:g}; check the masses and the belt'
        )
    version = write_version(arguments.output, arguments.source, found, points, arguments.params)
    print(f'{arguments.output}: version {version} written; start the line with it')


def _feed(arguments: argparse.Namespace) -> AbstractContextManager[SampleFeed]:
    """Return a feed with the samples of a running line or, with `--open`, of the source itself.

    Raises `CalibrationError` if the source has no calibration parameters.
    """
    check_calibrated_source(arguments.source)
    if not arguments.open:
        return line_feed(check_namespace(arguments.namespace))
    values = source_values(arguments.params, arguments.source) if arguments.params else {}
    kind = source_class(arguments.source)
    return source_feed(arguments.source, kind(kind.parameters.from_mapping(values)))


def _guided_points(
    feed: SampleFeed, masses: Sequence[float], mass_uncertainty: float, steadiness: Steadiness
) -> list[CalibrationPoint]:
    """Read the empty belt, each mass, and the empty belt again, and return the calibration points.

    Without masses, the empty belt is read only once. `masses` and `mass_uncertainty`, the standard
    uncertainty of each mass, are in kg.

    Raises `UserError` if the samples or the standard input end, and `CalibrationError` as
    `read_at_rest` does.
    """
    wanted = [0.0, *masses, 0.0] if masses else [0.0]
    points = []
    for mass in wanted:
        ask(f'Put {GRAMS * mass:g} g on the belt' if mass else 'Empty the belt')
        reading = read_at_rest(feed, feed.wait_for_load_cell(), steadiness, show)
        uncertainty = mass_uncertainty if mass else 0.0
        points.append(CalibrationPoint(mass, reading.mean, reading.std_error, uncertainty))
        print(f'{GRAMS * mass:g} g: reading {reading.mean:.1f} +- {reading.std_error:.1f}')
    return points


def read_at_rest(
    feed: SampleFeed, load_cell: LoadCell, steadiness: Steadiness, show: Callable[[str], None]
) -> StaticReading:
    """Return the reading of a load once the load has been at rest for long enough.

    `steadiness` contains the required duration, the largest drift, and the time limit. Samples that
    arrived before the call are not used. `show` is called with texts on the state of the
    measurement, and with '' at the end.

    Raises `CalibrationError` if the load does not come to rest within the time limit or the
    converter is at its limit, and `UserError` if no samples arrive.
    """
    feed.forget()
    reading, blocks = RestReading(load_cell, steadiness), feed.blocks()
    found = shown = None
    while found is None:
        found = reading.add(next(blocks))
        if reading.latest is not shown and reading.latest is not None:
            shown = reading.latest
            show(_line(shown, load_cell, reading.duration))
    show('')
    return found


def _line(reading: StaticReading, load_cell: LoadCell, duration: float) -> str:
    grams = GRAMS / load_cell.counts_per_kg  # g per count
    mass = grams * (reading.mean - load_cell.zero_counts)
    return (
        f'{duration:4.1f} s: {mass:10.3f} g as calibrated now, reading {reading.mean:.1f}, drift '
        f'{abs(grams) * reading.drift:+.3f} g, noise {abs(grams) * reading.noise:.3f} g'
    )
