# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dynamic setting at the terminal: passes of a known mass at several belt speeds."""

import argparse
from collections.abc import Iterable
from itertools import count
import math
from pathlib import Path
from statistics import median

from checkweigher_bringup import settings
from checkweigher_bringup.commissioning.terminal import ask
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.output import check_output_file
from checkweigher_bringup.recorder import ReferencePasses, record
from checkweigher_bringup.training import read_passes, train
from checkweigher_core.records import GRAMS
from checkweigher_core.whole_file import make_output_folder
from checkweigher_driver.calibration.file import check_not_installed, replace_version
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.passes import KnownPass

_MINUTE = 60.0  # s
_BUDGET = 240  # largest number of evaluations of each estimator at each speed
_TOLERANCE = 0.05  # maximum relative difference between the requested and the actual belt speed


def set_dynamically(arguments: argparse.Namespace) -> None:
    """Record passes at each speed, train on them, and replace the parameter file.

    The file is replaced only if the user confirms. Raises `UserError` if the options cannot be used
    together, if a recording has fewer passes than requested, or if the standard input ends.
    """
    _check(arguments)
    output: Path = arguments.output
    folder = arguments.bags or output.with_name(f'{output.stem}_passes')
    make_output_folder(folder, exist_ok=True)
    base = settings.line_parameters(arguments.params)
    bags = [_record_at(speed, folder, base, arguments) for speed in arguments.speeds]
    new = output.with_name(f'{output.stem}.new{output.suffix}')
    estimators = (
        settings.estimator_names([arguments.estimator], ()) if arguments.estimator else None
    )
    train(bags, new, estimators, base, budget=arguments.budget or _BUDGET)
    taken = ask(
        f'Type yes to write these parameters to {output}',
        f'the parameters were accepted; they are in {new}',
    )
    if taken.lower() not in ('y', 'yes'):
        print(f'{output}: not written; the parameters are in {new}')
        return
    print(f'{output}: version {replace_version(output, new)} written; start the line with it')


def check_passes(arguments: argparse.Namespace) -> None:
    """Raise `UserError` if the mass, the number of passes or the speeds are missing or invalid."""
    for option in ('reference', 'speeds'):
        if getattr(arguments, option) is None:
            raise UserError(f'--{option}: must be given with --dynamic')
    settings.check_positive(arguments, 'reference', 'passes', 'speeds')


def _check(arguments: argparse.Namespace) -> None:
    check_passes(arguments)
    settings.check_positive(arguments, 'budget')
    if arguments.source is not None or arguments.open:
        raise UserError('--dynamic: uses a running line, so leave out --source and --open')
    settings.check_namespace(arguments.namespace)
    settings.estimator_names([arguments.estimator or 'all'], ())
    check_output_file(arguments.output, overwrite=True)
    check_not_installed(arguments.output)


def _record_at(
    speed: float, folder: Path, base: LineParameters, arguments: argparse.Namespace
) -> Path:
    """Record passes until the belt speed is `speed` in m/min, and return the bag of these passes.

    Each attempt is recorded into a new bag. The belt speed may differ from `speed` by the relative
    difference `_TOLERANCE`. Raises `UserError` if a recording has fewer passes without faults than
    requested.
    """
    while True:
        ask(f'Set the belt to {speed:g} m/min and run the line')
        names = (folder / f'{speed:g}_{number}' for number in count(1))
        bag = next(path for path in names if not path.exists())
        known = ReferencePasses(arguments.reference / GRAMS, arguments.passes)
        record(bag, settings.check_namespace(arguments.namespace), inputs_only=True, passes=known)
        passes = [each for each in read_passes([bag], None, base.segmenter).passes if each.whole]
        if len(passes) < arguments.passes:
            raise UserError(
                f'{bag}: only {len(passes)} of {arguments.passes} passes were recorded; begin '
                'again, or use the command tune with the recorded bags'
            )
        found = belt_speed(passes)
        print(f'{bag}: {len(passes)} passes at {found:.2f} m/min')
        if not (other := other_speed(found, speed)):
            return bag
        print(f'{other}: this bag is not used')


def belt_speed(passes: Iterable[KnownPass]) -> float:
    """Return the median belt speed in m/min of the passes whose speed is known.

    Raises `UserError` if the speed of no pass is known.
    """
    known = [speed for each in passes if math.isfinite(speed := each.window.belt_speed)]
    if not known:
        raise UserError('the belt speed of no pass is known: check that both photo-eyes switch')
    return _MINUTE * median(known)


def other_speed(found: float, wanted: float) -> str:
    """Return a message if the belt speeds `found` and `wanted` in m/min differ, otherwise ''.

    A relative difference of up to `_TOLERANCE` is allowed.
    """
    same = abs(found / wanted - 1) <= _TOLERANCE
    return '' if same else f'the belt ran at {found:.2f} m/min, not at {wanted:g} m/min'
