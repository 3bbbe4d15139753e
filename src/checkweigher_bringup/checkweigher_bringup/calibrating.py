"""What `calibrate` does: it asks for masses one after the other and waits until each is at rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import sys

import numpy as np

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.sample_feed import SampleFeed
from checkweigher_driver.static_calibration import (
    CalibrationError,
    CalibrationPoint,
    StaticReading,
    read_static,
)
from checkweigher_dsp.records import LoadCell
from checkweigher_validation.results import GRAMS

_SHOW_PERIOD = 0.5  # s of signal


@dataclass(frozen=True, slots=True)
class Steadiness:
    """When a load counts as being at rest.

    Attributes
    ----------
    duration : float
        s, for which it is read.
    tolerance : float
        kg, by which the halves of that may differ.
    patience : float
        s, after which it is given up.
    """

    duration: float = 5.0
    tolerance: float = 1e-4
    patience: float = 60.0


def ask(text: str) -> None:
    """Ask for something to be done, and wait for Enter."""
    print(f'{text}, then press Enter ', end='', file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise UserError('the input ended before the calibration was done: nothing was written')
    if not sys.stdin.isatty():
        print(file=sys.stderr)


def read_at_rest(
    feed: SampleFeed, load_cell: LoadCell, steadiness: Steadiness, show: Callable[[str], None]
) -> StaticReading:
    """Return the reading of a load as soon as it has been at rest for long enough.

    Raises
    ------
    UserError
        If it does not come to rest, samples stay away, or the converter is at its limit.
    """
    feed.forget()
    rate = load_cell.sample_rate
    least = max(1, round(steadiness.duration * rate))
    tolerance = steadiness.tolerance * abs(load_cell.counts_per_kg)
    counts, seen, shown = np.zeros(0, np.int32), 0, 0
    reading = None
    for block, whole in feed.blocks():
        # Samples that were lost would hide what moved meanwhile.
        counts = np.concatenate([counts[-least:], block]) if whole else block
        seen += len(block)
        if seen - shown < _SHOW_PERIOD * rate:
            continue
        shown = seen
        try:
            reading = read_static(counts[-least:], load_cell.min_counts, load_cell.max_counts)
        except CalibrationError as error:
            if len(counts) < least:
                continue
            raise UserError(str(error)) from None
        show(_line(reading, load_cell, min(len(counts), least) / rate))
        if len(counts) >= least and reading.is_stable(tolerance):
            return reading
        if seen > steadiness.patience * rate:
            break
    assert reading is not None
    raise UserError(
        f'the load did not come to rest within {steadiness.patience:g} s: the halves of '
        f'{steadiness.duration:g} s differ by {_grams(reading.drift, load_cell):.3f} g, its mean '
        f'is known to {_grams(reading.std_error, load_cell):.3f} g, and both must be within '
        f'{GRAMS * steadiness.tolerance:g} g; check for wind, vibration and what touches the belt'
    )


def _line(reading: StaticReading, load_cell: LoadCell, duration: float) -> str:
    mass = (reading.mean - load_cell.zero_counts) / load_cell.counts_per_kg
    return (
        f'{duration:4.1f} s: {GRAMS * mass:10.3f} g as calibrated now, reading {reading.mean:.1f}, '
        f'drift {_grams(reading.drift, load_cell):+.3f} g, noise '
        f'{_grams(reading.noise, load_cell):.3f} g'
    )


def _grams(counts: float, load_cell: LoadCell) -> float:
    return GRAMS * counts / abs(load_cell.counts_per_kg)


def guided_points(
    feed: SampleFeed, masses: Sequence[float], mass_uncertainty: float, steadiness: Steadiness
) -> list[CalibrationPoint]:
    """Ask for an empty belt, each mass, and the empty belt again, and read each.

    Parameters
    ----------
    feed : SampleFeed
        Where the samples come from.
    masses : sequence of float
        kg; without any only the empty belt is read, once.
    mass_uncertainty : float
        kg, standard uncertainty of each.
    steadiness : Steadiness
        When a load is at rest.
    """
    load_cell = feed.wait_for_load_cell()
    wanted = [0.0, *masses, 0.0] if masses else [0.0]
    points = []
    for mass in wanted:
        ask(f'Put {GRAMS * mass:g} g on the belt' if mass else 'Empty the belt')
        reading = read_at_rest(feed, load_cell, steadiness, _show)
        _show('')
        points.append(
            CalibrationPoint(
                mass, reading.mean, reading.std_error, mass_uncertainty if mass else 0.0
            )
        )
        print(f'{GRAMS * mass:g} g: reading {reading.mean:.1f} +- {reading.std_error:.1f}')
    return points


def _show(text: str) -> None:
    """Show how it is going, on a terminal, in one line."""
    if sys.stderr.isatty():
        print(f'\r\x1b[K{text}', end='', file=sys.stderr, flush=True)
