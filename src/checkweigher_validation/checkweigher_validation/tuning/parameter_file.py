# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS parameter file with tuned parameters, and their accuracy as comments."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from itertools import dropwhile
import math

import numpy as np
import yaml

from checkweigher_core.parameters import Parameters
from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.errors import ConditionResult, distinct
from checkweigher_validation.accuracy.tables import coverage_table
from checkweigher_validation.tuning.tuner import UNTRAINED, Tuned

_WIDTH = 100  # preferred number of characters in a line of YAML
_SAME_MASS = 1e-6  # tolerance in kg for rounding errors of equal masses


def parameter_file(
    tuned: Mapping[str, Tuned],
    source: Sequence[str],
    made: datetime | None = None,
    compared: Mapping[str, Tuned] | None = None,
    reason: str = '',
) -> str:
    """Return the text of a parameter file.

    The file contains all parameters of the tuned estimators, and all other parameters that differ
    from their defaults. The first estimator of `tuned` is selected in the file, and `reason` is the
    reason for this choice in one line. `source` contains a line for each set of training passes.
    `made` is the time of tuning, by default now. `compared` contains the estimators in the table of
    accuracies, by default `tuned`.
    """
    made = made or datetime.now(UTC)
    lines = [
        '# Made by checkweigher tune; use it as --params, or as params_file of a launch.',
        f'# {made.isoformat(timespec="seconds")}',
        *(f'# from {_printable(line)}' for line in source),
        '#',
        '# A = |mean error| + 3 sigma in g, averaged over the masses, after gain and offset.',
        '# A held out: each pass is weighed with the parameters that other passes give. If it is',
        '# much larger than A trained, the parameters are overfitted.',
        *(
            f'# {line}'
            for name, each in tuned.items()
            if name != UNTRAINED
            for line in _coverage_lines(each)
        ),
        '#',
        f'# {"estimator":<14}{"m/min":>7}{"passes":>8}{"A trained":>11}{"A held out":>12}',
        *(
            f'# {name:<14}{60 * speed.speed:7.1f}{speed.passes:8}'
            f'{GRAMS * speed.index:11.4f}{GRAMS * speed.held_out_index:12.4f}'
            for name, each in (compared or tuned).items()
            for speed in each.speeds
        ),
        *((f'# chosen: {reason}',) if reason else ()),
    ]
    content = {
        f'/**/{node}': {'ros__parameters': values}
        for node, values in _sections(tuned).items()
        if values
    }
    body = yaml.safe_dump(
        content, default_flow_style=None, sort_keys=False, width=_WIDTH, allow_unicode=True
    )
    return '\n'.join(lines) + '\n' + body


def _coverage_lines(tuned: Tuned) -> list[str]:
    """Return the lines of a table with the coverage of the stated intervals by speed and mass.

    The coverage is computed from the held-out errors.
    """
    conditions = []
    for speed in tuned.speeds:
        errors, masses = np.array(speed.held_out_errors), np.array(speed.masses)
        for mass in distinct(speed.masses):
            own = np.abs(masses - mass) < _SAME_MASS
            stated = math.hypot(speed.uncertainty.std_dev, speed.uncertainty.relative * mass)
            std_devs = np.full(np.count_nonzero(own), stated or math.nan)
            conditions.append(
                ConditionResult(tuned.estimator, speed.speed, mass, 'train', errors[own], std_devs)
            )
    return coverage_table(conditions, f'{tuned.estimator} held out')


def _sections(tuned: Mapping[str, Tuned]) -> dict[str, dict[str, object]]:
    """Return the parameters that the file contains, by node and name."""
    first, *_ = tuned.values()
    sections = {
        entry.name: _changed(getattr(first.parameters, entry.name))
        for entry in fields(first.parameters)
    }
    changed = sections['identifier'].items()
    names = {each.estimator for each in tuned.values()}
    others = {key: value for key, value in changed if key.partition('.')[0] not in names}
    sections['identifier'] = {'estimator': first.estimator, **others}
    for each in tuned.values():
        name = each.estimator
        own = getattr(each.parameters.identifier, name).as_mapping()
        sections['identifier'][name] = _plain(own)
        if any(key.startswith('denoise.') for speed in each.speeds for key in speed.lists):
            sections['denoise'] = _plain(each.parameters.denoise.as_mapping())
    return sections


def accuracy_lines(text: str) -> list[str]:
    """Return the lines of the table of accuracies in a parameter file.

    The first line has the headings. The next lines describe the estimators, with a line for each
    speed. If the file has a reason for its choice, the last line is ``chosen: REASON``. The list is
    empty if the file has no table.
    """
    comments = (line.removeprefix('# ') for line in text.splitlines() if line.startswith('# '))
    return list(dropwhile(lambda line: not line.startswith('estimator '), comments))


def _plain(values: Mapping[str, object]) -> dict[str, object]:
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in values.items()
    }


def _changed(parameters: Parameters) -> dict[str, object]:
    defaults = type(parameters)().as_mapping()
    values = parameters.as_mapping()
    return _plain({name: value for name, value in values.items() if value != defaults[name]})


def _printable(text: str) -> str:
    """Return a text in which spaces replace all characters that cannot be printed.

    A line break in the text would end the comment.
    """
    return ''.join(sign if sign.isprintable() else ' ' for sign in text)
