# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What was learned as text, for a file that outlives the process."""

from dataclasses import asdict
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators.learned import PARTS
from checkweigher_dsp.estimation.learning.change import Change
from checkweigher_dsp.estimation.learning.learner import ItemKind, LearnedKinds
from checkweigher_dsp.estimation.learning.passage import Passage
from checkweigher_dsp.estimation.learning.regression import Fit

_VERSION = 1
_ARRAYS = ('curve', 'weights', 'noise')


def to_text(known: LearnedKinds) -> str:
    """Return all that is known, numbers to the last bit."""
    content = {'version': _VERSION, **asdict(known)}
    return json.dumps(content, default=lambda array: array.tolist())


def from_text(text: str) -> LearnedKinds:
    """Return what `to_text` wrote; ValueError if that is not it."""
    try:
        content = json.loads(text)
        if content['version'] != _VERSION:
            raise ValueError(f'version {content["version"]!r}, not {_VERSION}')
        return LearnedKinds(str(content['basis']), tuple(_kind(each) for each in content['kinds']))
    except (KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f'not what was learned: {error!r}') from None


def _kind(values: dict[str, Any]) -> ItemKind:
    found, change = values['fit'], values['change']
    taught = None if found is None else _fit(found)
    return ItemKind(
        float(values['speed']), float(values['length']), int(values['rise']), int(values['items']),
        tuple(_passage(each) for each in values['passages']), taught,
        tuple(_array(each, len(taught.weights)) for each in values['recent']) if taught else (),
        None if change is None else Change(**change),
    )  # fmt: skip


def _passage(values: dict[str, Any]) -> Passage:
    parts = _array(values.pop('parts'))
    if len(parts) < PARTS:
        raise ValueError(f'{len(parts)} parts of a pass')
    return Passage(parts, **values)


def _fit(values: dict[str, Any]) -> Fit:
    count = len(values['weights'])
    if count < PARTS:
        raise ValueError(f'{count} weights')
    arrays: dict[str, Any] = {name: _array(values.pop(name), count) for name in _ARRAYS}
    spectrum = _array(values.pop('spectrum'), count // 2 + 1)
    smallest, largest = values.pop('loads')
    return Fit(**arrays, spectrum=spectrum, loads=(float(smallest), float(largest)), **values)


def _array(values: object, count: int | None = None) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    if array.ndim != 1 or (count is not None and len(array) != count):
        raise ValueError(f'a list of {array.shape} numbers')
    if not np.all(np.isfinite(array)):
        raise ValueError('a number that is not finite')
    return array
