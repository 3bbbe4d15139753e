# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuned parameters as a ROS parameter file that names its training passes."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from itertools import dropwhile

import yaml

from checkweigher_core.parameters import Parameters
from checkweigher_core.records import GRAMS
from checkweigher_validation.tuning.tuner import Tuned

_WIDTH = 100


def parameter_file(
    tuned: Mapping[str, Tuned],
    source: Sequence[str],
    made: datetime | None = None,
    compared: Mapping[str, Tuned] | None = None,
    reason: str = '',
) -> str:
    """Return the text of a parameter file with all tuned parameters.

    The file has all parameters of the tuned estimators, and other parameters that differ from their
    defaults. It selects the first estimator of `tuned`; `reason` is a line that says why. `source`
    has a line for each set of training passes, and `made` is the time of tuning, by default now.
    `compared` has the estimators in the table at the head, by default `tuned`.
    """
    made = made or datetime.now(UTC)
    lines = [
        '# Made by checkweigher tune; use it as --params, or as params_file of a launch.',
        f'# {made.isoformat(timespec="seconds")}',
        *(f'# from {_printable(line)}' for line in source),
        '#',
        '# A = |mean error| + 3 sigma, averaged over the masses, after gain and offset, in g; held',
        '# out: each half of the passes weighed by what the other half taught. Much more than',
        '# trained would mean that the parameters fit these passes and not the machine.',
        '#',
        f'# {"estimator":<14}{"m/min":>7}{"passes":>8}{"A trained":>11}{"A held out":>12}',
        *(
            f'# {each.estimator:<14}{60 * speed.speed:7.1f}{speed.passes:8}'
            f'{GRAMS * speed.index:11.4f}{GRAMS * speed.held_out_index:12.4f}'
            for each in (compared or tuned).values()
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


def _sections(tuned: Mapping[str, Tuned]) -> dict[str, dict[str, object]]:
    """Return the parameters of each node that are in the file."""
    first, *_ = tuned.values()
    sections = {
        entry.name: _changed(getattr(first.parameters, entry.name))
        for entry in fields(first.parameters)
    }
    changed = sections['identifier'].items()
    others = {key: value for key, value in changed if key.partition('.')[0] not in tuned}
    sections['identifier'] = {'estimator': first.estimator, **others}
    for name, each in tuned.items():
        own = getattr(each.parameters.identifier, name).as_mapping()
        sections['identifier'][name] = _plain(own)
        if any(key.startswith('denoise.') for speed in each.speeds for key in speed.lists):
            sections['denoise'] = _plain(each.parameters.denoise.as_mapping())
    return sections


def accuracy_lines(text: str) -> list[str]:
    """Return the table of accuracies at the head of a parameter file, and the reason of the choice.

    The lines are the headings, a line for each estimator at each speed, and ``chosen: ...`` if the
    file has a reason. A file that was not tuned has none.
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
    """Return a text from a bag without characters that would end the comment."""
    return ''.join(sign if sign.isprintable() else ' ' for sign in text)
